"""JSBSim models read: aerodynamics as Python functions, metrics and mass as a vehicle file."""
