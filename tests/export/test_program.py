"""The program of torch.export: the planner's probabilities, for any rig."""

from pathlib import Path

import torch
from exported_run import Exported

from shoot.export import program
from shoot.export.program import write_program
from shoot.export.samples import inputs_of


def test_a_program_read_back_says_what_the_planner_says(exported: Exported, tmp_path: Path) -> None:
    file = tmp_path / "planner.pt2"
    write_program(exported.graph, file)
    assert str(Path(program.__file__).parents[2]).encode() not in file.read_bytes()
    planner = torch.export.load(file).module()
    sensors = exported.without(2)
    expected = torch.tensor(exported.expected(sensors))
    assert expected.std() > 0.005
    for b in range(3):
        inputs = inputs_of(exported.card, sensors, b)
        prob, _ = planner(**{name: torch.tensor(value) for name, value in inputs.items()})
        torch.testing.assert_close(prob[0], expected[b], rtol=0.0, atol=1e-5)
    # The missing camera is the third of six: a rig of the first two needs no more than their share.
    inputs["images"] = inputs["images"][:, :2]
    inputs["splat_index"] = inputs["splat_index"][:, inputs["splat_index"][0] < 2 * 4 * 12]
    prob, _ = planner(**{name: torch.tensor(value) for name, value in inputs.items()})
    others = torch.tensor(exported.expected(exported.without(2, 3, 4, 5)))
    torch.testing.assert_close(prob[0], others[2], rtol=0.0, atol=1e-5)
