"""Describe bodies, joints and forces as plain arrays, and evaluate the laws of their motion."""
