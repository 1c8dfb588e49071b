"""A record of metrics has one row a step, also over kills and resumptions."""

from pathlib import Path

from shoot.training.metrics_file import MetricsFile, read_metrics


def test_metrics_of_a_step_share_a_row(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    record = MetricsFile(path, resume=False)
    record.log_metrics({"loss": 2.5}, 0)
    record.log_metrics({"rate": 0.25}, 0)
    record.log_metrics({"loss": 1.5}, 10)
    record.log_metrics({"rate": 0.125, "loss": 1.25}, 10)
    assert path.read_text() == "step,loss,rate\n0,2.5,0.25\n10,1.25,0.125\n"


def test_resumed_record_forgets_what_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    record = MetricsFile(path, resume=False)
    for step in (0, 10, 20, 30):
        record.log_metrics({"loss": float(step)}, step)
    record.log_metrics({"top10": 7.0}, 30)
    resumed = MetricsFile(path, resume=True)
    assert len(read_metrics(path)) == 4  # nothing is lost before something comes
    resumed.log_metrics({"rate": 0.5, "loss": -1.0}, 20)
    assert read_metrics(path) == {
        0: {"loss": "0"},
        10: {"loss": "10"},
        20: {"loss": "-1", "rate": "0.5"},
    }
    MetricsFile(path, resume=False).log_metrics({"loss": 3.0}, 0)
    assert path.read_text() == "step,loss\n0,3\n"


def test_line_cut_off_by_a_kill_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("step,loss,rate\n0,2,0.5\n10,1")
    MetricsFile(path, resume=True).log_metrics({"loss": 4.0}, 20)
    assert path.read_text() == "step,loss,rate\n0,2,0.5\n20,4,\n"
    assert read_metrics(tmp_path / "none.csv") == {}
