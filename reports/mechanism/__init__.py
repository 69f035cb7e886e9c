"""The mechanism itself: bodies as lines, moving pictures, the theatre."""
