"""What stability margins compile: the plant and laws at single points, loop gains, structured singular values."""
