"""Vehicle with six degrees of freedom: the simulator of flights with a mission and control laws."""
