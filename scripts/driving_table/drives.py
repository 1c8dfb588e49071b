"""Who drives in the closed-loop study: simple drivers, and all planners of docs/results.md."""

from dataclasses import dataclass

from planning_table.experiments import LIMITS, PLANNERS, TABLE
from run_queue import Experiment

from shoot.simulation.drivers.choice import Choose
from shoot.simulation.drivers.making import DriverName
from shoot.simulation.route_log import Mode

MODES: tuple[Mode, ...] = ("reactive", "replay")


@dataclass(frozen=True)
class Drive:
    """One driver, on all routes.

    Attributes:
        driver: Of `shoot-simulate`.
        run: The run it drives by; of `prior` and `oracle` any will do, as all have the same
            templates and the same training data.
        choose, route_gate: See `DriverSettings`.
    """

    driver: DriverName
    run: Experiment | None = None
    choose: Choose = "most_probable"
    route_gate: bool = True

    @property
    def who(self) -> str:
        """In records: the driver, or the planner, which all its seeds are."""
        return self._marked("run" if self.run is None else self.run.planner)

    @property
    def name(self) -> str:
        """Of its folder and of its records, the mode aside."""
        return self._marked("run" if self.run is None else self.run.name)

    def _marked(self, name: str) -> str:
        marks = [name if self.driver == "run" else self.driver]
        marks += ["expected"] if self.choose == "expected" else []
        marks += [] if self.route_gate else ["free"]
        return "-".join(marks)


_ANY = TABLE[0]
SIMPLE = (
    Drive("rule"),
    Drive("oracle", _ANY),
    Drive("constant_velocity"),
    Drive("still"),
    Drive("prior", _ANY),
    Drive("prior", _ANY, choose="expected"),
)
PLANNED = tuple(Drive("run", experiment) for experiment in (*TABLE, *LIMITS))
# What the driver decides and not the network: for the planners of Table 6, by their first seed.
_FIRST = tuple(experiment for experiment in TABLE if experiment.seed == 0)
FREE = (
    Drive("prior", _ANY, choose="expected", route_gate=False),
    *(Drive("run", experiment, route_gate=False) for experiment in _FIRST),
)
EXPECTED = tuple(Drive("run", experiment, choose="expected") for experiment in _FIRST)
STUDY = (*SIMPLE, *PLANNED, *FREE, *EXPECTED)

_WORDS = {
    **PLANNERS,
    "rule": "rule driver",
    "oracle": "oracle: the template nearest to the rules'",
    "constant_velocity": "constant velocity",
    "still": "standing still",
}


def in_words(who: str) -> str:
    """A driver's name in tables, from `Drive.who`."""
    name = who.removesuffix("-free").removesuffix("-expected")
    words = _WORDS.get(name, f"`{name}`" if name.startswith(tuple(PLANNERS)) else name)
    words += ", least far template" if "-expected" in who else ""
    return f"{words}, no gate" if who.endswith("-free") else words
