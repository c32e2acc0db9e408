"""Import of JSBSim models: aerodynamics as Python functions, metrics and mass as a vehicle file."""
