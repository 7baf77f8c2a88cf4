"""The paper's simulation: χ̇ = J(𝔮)ζ + w, the velocity ζ is the input and w moves the tip."""
