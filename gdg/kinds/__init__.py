"""The kinds of components: one abstract class each, and the data they exchange."""
