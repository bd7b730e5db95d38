"""The learners by name: how Q-values are represented and learned."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from qboot.qlearning import adam, double_dqn, fitted_q, one_network
from qboot.qlearning.networks import init_networks, q_values
from qboot.qlearning.replay import replay_best
from qboot.qlearning.updates import td_update


class Learner(NamedTuple):
    """What distinguishes one learner from another; acting, episodes and the store of trajectories are common to all.

    Networks are any pytree that `init` returns: weights, and whatever else has to last from one update to the
    next, such as an optimiser's moments, or a target network and the number of updates since it was copied.
    Padding must not show: the first values of an action do not depend on how many actions and inputs there are.

    Another optimiser or another target (Double DQN) is a row with its own `init` and `update`; one network with
    an output per action is one with its own `values`, too. A learner that fits all trajectories at once (fitted Q)
    has an `update` that changes nothing, and does its work in `replay`.
    """

    init: Callable[..., Any]
    """(key, n_actions A, n_inputs I, hidden) -> networks that have learned nothing."""

    values: Callable[..., Any]
    """(networks, inputs (I,)) -> Q-values (A,)."""

    update: Callable[..., Any]
    """(networks, transition, action_mask (A,), alpha, active ()) -> networks, values (A,) of the state after the
    transition, error (); after every action, see `updates.td_update`."""

    replay: Callable[..., Any]
    """(networks, key, store, action_mask (A,), alpha) -> networks, sum () of |error|, number () of updates; after
    every episode, see `replay.replay_best`."""

    replays_room: bool = False
    """Whether a replay costs what the store has room for, not what it holds."""


LEARNERS = {
    "q_learning": Learner(init_networks, q_values, td_update, partial(replay_best, td_update)),
    "adam": Learner(adam.init, adam.values, adam.update, partial(replay_best, adam.update)),
    "double_dqn": Learner(
        double_dqn.init, double_dqn.values, double_dqn.update, partial(replay_best, double_dqn.update)
    ),
    "one_network": Learner(
        one_network.init, one_network.values, one_network.update, partial(replay_best, one_network.update)
    ),
    "fitted_q": Learner(init_networks, q_values, fitted_q.update, fitted_q.fit, replays_room=True),
}
