"""The objects of the picture, one a file: robot, surface, tube, arrows, texts."""
