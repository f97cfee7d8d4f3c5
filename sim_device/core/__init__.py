"""The firmware in C, compiled for this computer, on a virtual board in the virtual sweeper."""
