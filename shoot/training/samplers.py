"""Which samples are read, and when: the same for any number of processes, also after a kill."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Sampler

from lss_core.errors import DataError


class StepSampler(Sampler[tuple[int, int]]):
    """An endless shuffled stream of samples, cut into rounds of a fixed number of steps.

    The stream passes over all samples in a new order each time. What step s of the run reads
    follows from the seed and s alone: a resumed run, and any number of processes that share the
    global batch, read the same as an undisturbed one.

    Args:
        num_samples: Samples to draw from.
        steps: Steps of a round; one iteration reads them.
        global_batch: Samples a step, over all processes.
        seed: Of the order.
        rank: Which process this is.
        world_size: Number of processes.
        steps_done: Tells at which step of the run an iteration begins. (Lightning's number of the
            epoch does not: it is one too many after a run is resumed.)
    """

    def __init__(
        self,
        num_samples: int,
        steps: int,
        global_batch: int,
        seed: int,
        rank: int = 0,
        world_size: int = 1,
        steps_done: Callable[[], int] = lambda: 0,
    ) -> None:
        self.num_samples = num_samples
        self.steps = steps
        self.global_batch = global_batch
        self.seed = seed
        self.rank = rank
        self.world_size = world_size
        self.steps_done = steps_done

    def __len__(self) -> int:
        return self.steps * self.global_batch // self.world_size

    def __iter__(self) -> Iterator[tuple[int, int]]:
        first = self.steps_done() * self.global_batch
        order, order_of = np.zeros(0, dtype=np.int64), -1
        for draw in range(
            first + self.rank, first + self.steps * self.global_batch, self.world_size
        ):
            passes, place = divmod(draw, self.num_samples)
            if passes != order_of:
                rng = np.random.default_rng((self.seed, passes))
                order, order_of = rng.permutation(self.num_samples), passes
            yield int(order[place]), draw


class ShareSampler(Sampler[tuple[int, int]]):
    """Every `world_size`-th of the positions, in order, none twice: shares may differ by one."""

    def __init__(self, positions: NDArray[np.int64], rank: int = 0, world_size: int = 1) -> None:
        self.positions = positions[rank::world_size]

    def __len__(self) -> int:
        return len(self.positions)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return ((int(position), -1) for position in self.positions)


def check_shares(batch_size: int, num_processes: int) -> None:
    """Check that all processes get equally many samples of a batch.

    Raises:
        DataError: If not.
    """
    if batch_size % num_processes:
        raise DataError(
            f"A batch of {batch_size} cannot be shared by {num_processes} processes; choose "
            "--optim.batch-size as a multiple of them."
        )
