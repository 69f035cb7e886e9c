"""Bodies, joints and forces as plain arrays, and the laws of their motion."""
