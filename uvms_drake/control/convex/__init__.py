"""The solver cascade of the convex program of one SQP iteration."""
