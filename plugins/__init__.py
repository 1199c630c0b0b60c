"""Built-in components: one folder per plugin, registered like everyone else's."""
