"""A leader and its followers, which navigate with the depth of their cameras."""
