"""Papers that the package reproduces, one a folder; nothing else depends on them."""
