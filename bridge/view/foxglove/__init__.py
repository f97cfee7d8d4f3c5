"""The live server for Foxglove."""
