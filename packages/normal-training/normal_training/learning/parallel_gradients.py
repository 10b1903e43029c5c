"""Gradients worked out by two threads at once, each for its half of the batch.

Convolutions of one picture on two cores wait for each other at every layer; two pictures on one
core each do not. What is learned does not depend on how many cores there are.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor, nn

LANES = 2
"""Parts that a batch is divided into."""


class Lanes:
    """Copies of a network that share its weights and have gradients of their own.

    Args:
        network: Whose weights may change in place, and no other way.
        count: Number of copies, which an attribute keeps.
    """

    def __init__(self, network: nn.Module, count: int) -> None:
        self.count = count
        self._network = network
        self._copies = [copy.deepcopy(network) for _ in range(count)]
        for lane in self._copies:
            for mine, yours in zip(lane.parameters(), network.parameters(), strict=True):
                mine.data = yours.data
        threads = max(1, torch.get_num_threads() // count)
        # The setting is each thread's own.
        self._pool = ThreadPoolExecutor(count, initializer=lambda: torch.set_num_threads(threads))

    def descend(self, loss: Callable[[int, nn.Module], Tensor]) -> float:
        """Set the gradients of the network's weights to those of the mean loss, and return it.

        Args:
            loss: That of a part of the batch, by its number, as a copy of the network answers it.
        """

        def work(number: int) -> float:
            lane = self._copies[number].train()
            lane.zero_grad(set_to_none=True)
            value = loss(number, lane)
            value.backward()
            return float(value.detach())

        losses = list(self._pool.map(work, range(len(self._copies))))
        if len(self._copies) == 1:
            # The mean of one, without thousands of small sums that another device would wait for.
            only = self._copies[0]
            for parameter, same in zip(self._network.parameters(), only.parameters(), strict=True):
                parameter.grad = same.grad
            return losses[0]
        lanes = zip(*(lane.parameters() for lane in self._copies), strict=True)
        for parameter, copies in zip(self._network.parameters(), lanes, strict=True):
            found = [each.grad for each in copies if each.grad is not None]
            parameter.grad = torch.stack(found).sum(0) / len(copies) if found else None
        return sum(losses) / len(losses)
