"""What a loader's worker tells of a reader that is gone, and of everything else."""

import sys
import threading
import traceback

import pytest
from torch.utils.data import DataLoader

from shoot.jobs.lost_processes import quiet_loader


class FailingThread:
    """A data set whose worker has a thread that fails, as the one that hands over tensors may."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __len__(self) -> int:
        return 1

    def __getitem__(self, _position: int) -> str:
        thread = threading.Thread(target=self.fail_as_resource_sharer)
        thread.start()
        thread.join()
        return "read"

    def fail_as_resource_sharer(self) -> None:
        try:
            raise self.error
        except Exception as error:
            sys.excepthook(type(error), error, error.__traceback__)


@pytest.mark.parametrize(
    ("error", "is_told"),
    [
        (ConnectionResetError(104, "Connection reset by peer"), False),
        (BrokenPipeError(32, "Broken pipe"), False),
        (EOFError(), False),
        (ValueError("a fault"), True),
        (OSError(28, "No space left on device"), True),
    ],
)
def test_thread_of_a_worker(
    error: Exception,
    is_told: bool,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "excepthook", traceback.print_exception)
    loader = DataLoader(FailingThread(error), num_workers=1, worker_init_fn=quiet_loader)
    assert list(loader) == [["read"]]
    assert ("Traceback" in capfd.readouterr().err) == is_told
