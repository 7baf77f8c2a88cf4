"""Convex program of a plan whose artificial reference is decided, too."""

from dataclasses import replace

import numpy as np

from uvms_drake.control.convex.staged_program import RadiusBound, StagedProgram


def with_place(program: StagedProgram, moved: np.ndarray, H: np.ndarray, g: np.ndarray,
               radius_bound: RadiusBound | None) -> StagedProgram:
    """Returns a program in which the shift a of the reference changes as well, by b ∈ R^m.

    The state of the program given is ξ = (y − y_des − E a, ζ), which moves back when the reference
    moves on; that of the program returned is (ξ, a), and a stage before the first decides b:

        ξ_0 = −(E b, 0),  a_0 = b;   ξ_{k+1} = A_k (ξ_k + E a) + B_k w_k − E a,  a_{k+1} = a_k.

    The cost depends on ξ alone: the input, without contact, is the same everywhere. Motion and
    limits change with y, hence with a as with the same components of ξ; the motion does with a
    turn, not with a translation, for which A_k E = E.

    Args:
        program: The program about a fixed reference.
        moved: Indices of the components of ξ that a moves (m,): E selects them.
        H: Hessian of the cost of b (m, m).
        g: Gradient of the cost of b (m,).
        radius_bound: Bounds of the terminal radius, functions of (ξ, a).
    """
    N, nx, nw = program.B.shape
    linear, end, m = program.linear, program.terminal, len(moved)
    size = nx + m

    def spread(rows: np.ndarray, first: int = 0) -> np.ndarray:
        """Returns rows of (ξ, w) as rows of (ξ, a, w), with `first` rows of zeros before."""
        out = np.zeros((first + len(rows), *rows.shape[1:-1], size + nw))
        own = out[first:]
        own[..., :nx], own[..., nx: size] = rows[..., :nx], rows[..., moved]
        own[..., size:] = rows[..., nx:]
        return out

    def after(first: float, values: np.ndarray) -> np.ndarray:
        """Returns values of every stage, and `first` for the one before."""
        out = np.empty((len(values) + 1, *values.shape[1:]))
        out[0], out[1:] = first, values
        return out

    # Motion: the first stage decides b, which no later one changes.
    A, B = np.zeros((N + 1, size, size)), np.zeros((N + 1, size, nw))
    A[1:, :nx, :nx], B[1:, :nx] = program.A, program.B
    A[1:, :nx, nx:] = program.A[..., moved]
    A[1:, moved, range(nx, size)] -= 1.0
    A[:, range(nx, size), range(nx, size)] = 1.0
    A[0, range(nx), range(nx)] = 1.0
    B[0, moved, range(m)], B[0, range(nx, size), range(m)] = -1.0, 1.0

    # Costs: those of ξ and w as before, and of b at the first stage.
    costs, gradients = np.zeros((N + 1, size + nw, size + nw)), np.zeros((N + 1, size + nw))
    for rows, own in ((slice(nx), slice(nx)), (slice(size, None), slice(nx, None))):
        costs[1:, rows, :nx] = program.H[:, own, :nx]
        costs[1:, rows, size:] = program.H[:, own, nx:]
        gradients[1:, rows] = program.g[:, own]
    decided = costs[0, size:, size:]
    decided[...] = np.eye(nw)  # Unused decisions of this stage.
    decided[:m, :m], gradients[0, size: size + m] = H, g

    # The end has no cost of a.
    H_end, g_end, T = np.zeros((size, size)), np.zeros(size), np.zeros((len(end.T), size))
    H_end[:nx, :nx], g_end[:nx], T[:, :nx] = program.H_end, program.g_end, end.T

    # Limits: none at the first stage.
    return replace(
        program, A=A, B=B, H=costs, g=gradients, H_end=H_end, g_end=g_end,
        linear=linear._replace(
            C=spread(linear.C, 1), value=after(0.0, linear.value),
            lower=after(-np.inf, linear.lower), upper=after(np.inf, linear.upper)),
        norms=tuple(limit._replace(
            C=spread(limit.C), value=after(0.0, limit.value), bound=after(np.inf, limit.bound))
            for limit in program.norms),
        terminal=end._replace(T=T, radius_bound=radius_bound))
