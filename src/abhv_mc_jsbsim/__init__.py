"""Import of JSBSim models as a Python aerodynamics function and a vehicle file."""
