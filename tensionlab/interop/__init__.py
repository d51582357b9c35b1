"""Doors to other libraries and their files: MuJoCo, MJCF, CASPR, PyTorch, JAX, Lab Streaming Layer."""
