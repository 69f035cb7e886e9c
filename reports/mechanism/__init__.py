"""Show the mechanism itself: bodies as line segments, moving pictures, the theatre."""
