"""What an object is: its mesh, surface points, signed-distance grid and convex parts."""
