"""Peak-to-peak gains of the linear loops of the error dynamics, continuous and sampled."""
