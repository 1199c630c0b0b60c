"""What people look at: tables, pictures and the interactive report of a set of grasps."""
