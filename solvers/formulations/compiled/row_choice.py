"""Choice of other rows of S where those kept become nearly dependent although all rows together do not (compiled).

The factor takes rows in a fixed order and leaves out those that depend on earlier ones. Along a motion a kept row may
come into the span of the others while a row left out leaves it, as in Bennett's linkage with its crank at 180 degrees:
the two rows change roles, and the motion is regular, but no step crosses the pose with the kept rows. Rows are then
taken by the largest pivot next, each as a share of its own diagonal; the others are left out of the same factor, until
the rows of the fixed order are well independent again. Near a change of rank no choice is better, and the kept rows
stay. Code made for a mechanism also factorises in a fixed order, and rows are chosen in the same way from the pivots
that it returns.

``k`` is a ``Kernel``, ``state`` its record.
"""

import math

from ....harness.mechanics.loops import has_loops
from ....harness.mechanics.system import MultibodySystem
from .blocks import WIDTH
from .entries import compile_inline, compile_inline_fused, run
from .factor import DEPENDENT, assemble, eliminate, turn_rows, turn_rows_back

# Half and twice of the numbers from POOR to AGAIN change at which steps of two of Bennett's linkages rows are
# exchanged: RATTLE's iterations by at most 0.3 %, its ends after 5 s by 2e-13 m. Those of VAGUE change no bit, nor does
# any of them on two four-bar cells and a mechanism with joints declared twice; Bricard's and a planar linkage and a
# grid keep their bits at half and twice of POOR.
POOR = 1e-2  # share of its own diagonal (a squared sine) of a kept row's pivot, at which others are searched for
WORN = 0.1  # the same as a share of the least pivot at the start
# multiple of a poor pivot at which the rows by order are used again: a step's repetitions keep its rows
RECOVERED = 4.0
BETTER, GOOD = 10.0, 0.2  # others are taken above this multiple of the kept rows' least pivot; share of what is poor
AGAIN = 0.25  # share of the least pivot at a vain search, to search again
VAGUE = 1e-6  # pivot that an error of the pose may leave for a dependent row
NEVER, IN_USE, BEFORE = range(3)  # whether rows are chosen
KEEP, AS_CHOSEN, SEARCH = range(3)  # what is done with a factor
MOST_ROWS = 300  # rows of a mechanism at most: a search costs their cube


def may_choose(system: MultibodySystem) -> bool:
    """Return whether rows may be chosen: joints close loops, since rows of a tree are independent, and rows are few."""
    return 0 < system.nrows <= MOST_ROWS and has_loops(system)


def choose_rows(k):
    """Keep the factor in ``k.L``, or factorise on other rows where the kept ones are nearly dependent.

    ``k.chosen`` and ``k.state`` are updated.
    """
    _choose_rows(k, WIDTH)


def choose_rows_points(k):
    """Choose rows like ``choose_rows``, for systems in which no joint has more than three rows."""
    _choose_rows(k, 3)


def leave_out(k):
    """Set ``k.rhs`` to zero in the constraint rows left out of the factor.

    Their multipliers may come from an estimate by steps that kept these rows, and no solution corrects them. Before the
    first choice they have always been zero, and nothing is done.
    """
    if k.state.chosen == NEVER:
        return
    b = k.blocks
    turn_rows(k, k.rhs)
    for col in range(len(b.joint)):
        for c in range(b.size[col]):
            if k.L[b.start[col], c, c] == 0.0:
                k.rhs[b.row[col] + c] = 0.0
    turn_rows_back(k, k.rhs)


def choose_rows_of_code(k):
    """Keep the factor that code of the mechanism has made, or factorise on better rows."""
    state, rank = k.state, _rank_of_code(k)
    least = _least_pivot_of_code(k)
    action = _decide_on_factor(state, len(k.inverse_share), rank, least)
    if action == KEEP:
        return
    if action == AS_CHOSEN:
        _repeat_on_chosen(k)
        if _rank_of_code(k) == rank and _least_pivot_of_code(k) > state.poor:
            return
    run(k.fill_dense)
    if _accept_choice(state, _mark_rows(k, rank, state.first), least):
        _repeat_on_chosen(k)
    else:
        run(k.factorise_code)


def leave_out_of_code(k):
    """Set ``k.rhs`` to zero in the rows left out, like ``leave_out``, for a factor by code of the mechanism."""
    if k.state.chosen == NEVER:
        return
    for a in range(len(k.rhs)):
        if k.inverse_share[a] == 0.0:
            k.rhs[a] = 0.0


@compile_inline
def _decide_on_factor(state, n, rank, least):
    """Return what to do with a factor of ``n`` rows in the fixed order: KEEP, AS_CHOSEN or SEARCH.

    ``rank`` is the number of rows kept in it, ``least`` their least pivot as a fraction of its diagonal. AS_CHOSEN is
    to repeat it on the rows chosen before, SEARCH to choose anew. The limits in ``state`` are updated.
    """
    if rank >= n:
        state.first = rank if state.first < 0 else state.first
        return KEEP
    if state.first < 0:
        state.first, state.poor = rank, min(POOR, WORN * least)
        state.limit = state.poor
    if state.chosen == IN_USE:
        if least > RECOVERED * state.poor:
            state.chosen = BEFORE
            return KEEP
        return AS_CHOSEN
    if least > state.poor:
        state.limit = state.poor
        return KEEP
    return KEEP if least > state.limit else SEARCH


@compile_inline
def _accept_choice(state, better, least):
    """Return whether to use the rows found, whose least pivot is ``better``, in place of those with ``least``.

    ``state`` is updated: whether chosen rows are in use, and the pivot below which the next search is made.
    """
    if better > BETTER * max(least, GOOD * state.poor):
        state.chosen = IN_USE
        return True
    state.limit = AGAIN * least
    state.chosen = BEFORE if state.chosen != NEVER else NEVER
    return False


@compile_inline_fused
def _choose_rows(k, W):
    """Keep the factor of the fixed order, or factorise on rows chosen before or newly found, in blocks (W, W)."""
    state, rank = k.state, k.state.rank
    least = _least_pivot(k) if rank < len(k.diagonal) else 1.0
    action = _decide_on_factor(state, len(k.diagonal), rank, least)
    if action == KEEP:
        return
    if action == AS_CHOSEN:
        assemble(k, W)
        _exclude_others(k)
        eliminate(k, W)
        if state.rank == rank and _least_pivot(k) > state.poor:
            return
    assemble(k, W)
    _copy_scaled(k)
    better = _mark_rows(k, rank, state.first)
    assemble(k, W)
    if _accept_choice(state, better, least):
        _exclude_others(k)
    eliminate(k, W)


@compile_inline
def _repeat_on_chosen(k):
    """Factorise again by code, on the chosen rows alone: the pivot bound of the others is infinite meanwhile."""
    for a in range(len(k.pivot_bound)):
        if k.chosen[a] == 0:
            k.pivot_bound[a] = math.inf
    run(k.factorise_code)
    for a in range(len(k.pivot_bound)):
        k.pivot_bound[a] = DEPENDENT


@compile_inline
def _rank_of_code(k):
    """Return the number of rows kept in a factor by code, and set ``k.state.rank`` to it."""
    rank = 0
    for a in range(len(k.inverse_share)):
        rank += k.inverse_share[a] > 0.0
    k.state.rank = rank
    return rank


@compile_inline
def _least_pivot_of_code(k):
    """Return the least pivot in a factor by code, each as a fraction of its diagonal entry of S; at most 1.

    The code returns the inverse of each fraction.
    """
    most = 1.0
    for a in range(len(k.inverse_share)):
        most = max(most, k.inverse_share[a])
    return 1.0 / most


@compile_inline
def _exclude_others(k):
    """Set ``k.diagonal`` to infinity for the rows not chosen, so that ``eliminate`` leaves them out."""
    for a in range(len(k.diagonal)):
        if k.chosen[a] == 0:
            k.diagonal[a] = math.inf


@compile_inline
def _least_pivot(k):
    """Return the least pivot of the rows kept in ``k.L``, each as a fraction of its diagonal entry of S; at most 1."""
    b, least = k.blocks, 1.0
    for col in range(len(b.joint)):
        for c in range(b.size[col]):
            inverse = k.L[b.start[col], c, c]
            if inverse > 0.0:
                least = min(least, 1.0 / (inverse * inverse * k.diagonal[b.row[col] + c]))
    return least


@compile_inline
def _copy_scaled(k):
    """Copy S, scaled to a diagonal of one, to ``k.dense``; rows of zero diagonal stay zero."""
    b, S, n = k.blocks, k.dense, len(k.diagonal)
    for a in range(n):
        for c in range(n):
            S[a, c] = 0.0
    for col in range(len(b.joint)):
        for p in range(b.start[col], b.start[col + 1]):
            at, to = b.row[b.other[p]], b.row[col]
            for a in range(b.size[b.other[p]]):
                for c in range(b.size[col]):
                    square = k.diagonal[at + a] * k.diagonal[to + c]
                    if square > 0.0:
                        S[at + a, to + c] = k.L[p, a, c] / math.sqrt(square)
                        S[to + c, at + a] = S[at + a, to + c]


@compile_inline
def _mark_rows(k, rank, first):
    """Mark up to ``rank`` rows in ``k.chosen``, the one of largest pivot next; return the least pivot.

    S in ``k.dense``, scaled to a diagonal of one, is replaced by its Schur complements. Beyond the ``first`` rows, as
    many as were independent at the start, a pivot below ``VAGUE`` is due to an error of the pose, and marking ends.
    """
    S, chosen, n, least = k.dense, k.chosen, len(k.diagonal), 1.0
    for a in range(n):
        chosen[a] = 0
    for count in range(rank):
        best = -1
        for a in range(n):
            if chosen[a] == 0 and (best < 0 or S[a, a] > S[best, best]):
                best = a
        pivot = S[best, best]
        if not pivot > (VAGUE if count >= first else DEPENDENT):
            break
        chosen[best] = 1
        least = min(least, pivot)
        for a in range(n):
            if chosen[a] == 0:
                share = S[a, best] / pivot
                for c in range(n):
                    if chosen[c] == 0:
                        S[a, c] -= share * S[best, c]
    return least
