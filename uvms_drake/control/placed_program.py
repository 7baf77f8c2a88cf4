"""The convex program of a plan whose reference is decided, too."""

from dataclasses import replace

import numpy as np

from uvms_drake.control.staged_program import (
    LinearLimits,
    NormLimit,
    Room,
    StagedProgram,
)


def with_place(program: StagedProgram, H: np.ndarray, g: np.ndarray, room: Room | None
               ) -> StagedProgram:
    """Returns a program in which the translation a of the reference changes as well, by b ∈ R³.

    The state of the program given is ξ = (y − y_des − E a, ζ), which moves back when the reference
    moves on; that of the program returned is (ξ, a), and a stage before the first decides b:

        ξ_0 = −(E b, 0),  a_0 = b;   ξ_{k+1} = A_k ξ_k + B_k w_k,  a_{k+1} = a_k.

    What it costs depends on ξ alone. Motion and inputs without contact are the same everywhere, so
    A_k and B_k are those of the program given. What is limited changes with y, hence with a as it
    does with the first three components of ξ.

    Args:
        program: The program about a fixed reference.
        H: Hessian of the cost of b (3, 3).
        g: Gradient of the cost of b (3,).
        room: For the end, a function of (ξ, a).
    """
    N, nx, nw = program.B.shape
    size = nx + 3

    def spread(rows: np.ndarray) -> np.ndarray:
        """Rows of (ξ, w) as rows of (ξ, a, w)."""
        return np.concatenate([rows[..., :nx], rows[..., :3], rows[..., nx:]], axis=-1)

    def after(first: float, values: np.ndarray) -> np.ndarray:
        """Values of every stage, and `first` for the one before."""
        return np.concatenate([np.full_like(values[:1], first), values])

    A, B = np.tile(np.eye(size), (N + 1, 1, 1)), np.zeros((N + 1, size, nw))
    A[1:, :nx, :nx], B[1:, :nx] = program.A, program.B
    B[0, :3, :3], B[0, nx:, :3] = -np.eye(3), np.eye(3)

    costs, gradients = np.zeros((N + 1, size + nw, size + nw)), np.zeros((N + 1, size + nw))
    known = np.r_[:nx, size: size + nw]
    costs[np.ix_(range(1, N + 1), known, known)] = program.H
    gradients[1:, known] = program.g
    decided = costs[0, size:, size:]
    decided[...] = np.eye(nw)  # Of what this stage does not decide.
    decided[:3, :3], gradients[0, size: size + 3] = H, g

    linear, end = program.linear, program.terminal
    return replace(
        program, A=A, B=B, H=costs, g=gradients,
        H_end=np.pad(program.H_end, (0, 3)), g_end=np.pad(program.g_end, (0, 3)),
        linear=LinearLimits(
            after(0.0, spread(linear.C)), after(0.0, linear.value), after(-np.inf, linear.lower),
            after(np.inf, linear.upper), linear.soft),
        norms=tuple(NormLimit(spread(limit.C), after(0.0, limit.value), after(np.inf, limit.bound))
                    for limit in program.norms),
        terminal=end._replace(T=np.pad(end.T, ((0, 0), (0, 3))), room=room))
