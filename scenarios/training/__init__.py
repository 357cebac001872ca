"""Training of the networks of the library on rendered sequences. Only this package uses PyTorch."""
