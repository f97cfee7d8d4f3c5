"""The public Python API, which is thread-safe."""
