"""A leader and its followers, flying by what their cameras see."""
