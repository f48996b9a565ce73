//! NumPy arrays on disk.
