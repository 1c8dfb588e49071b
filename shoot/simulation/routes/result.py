"""What is said of one route: its scores, what happened, where the ego was."""

from dataclasses import asdict

from shoot.metrics.driving_score.facts import Facts, collect_facts
from shoot.metrics.driving_score.progress import LITTLE_M
from shoot.metrics.driving_score.route_scores import Bench2Drive, bench2drive
from shoot.metrics.driving_score.score import SUB_SCORES, DrivingScore, epdms
from shoot.simulation.filming.mishaps import Mishap
from shoot.simulation.route_log import RouteLog
from shoot.simulation.routes.orders import RouteOrder
from shoot.simulation.routes.result_files import Row
from shoot.simulation.routes.scene import FIRST_STEP, RouteScene, scene_of
from shoot.world.town.town import Town

# A tracked car stops a little short of where the rules do, and is no failure for that.
COMPLETE_SHARE = 0.95
_MM, _MRAD = 3, 4  # decimals


def score_rules(log: RouteLog, town: Town) -> float:
    """Metres that the world's own rule driver got, that count: the reference of progress.

    Args:
        log: Of `Simulator.finish_by_rules`.
        town: Its town.
    """
    scene = scene_of(log, town)
    score = epdms(scene.ego, scene.others, scene.ground.lawful, reference_progress_m=0.0)
    return score.counted_progress_m


def result_of(
    order: RouteOrder,
    log: RouteLog,
    scene: RouteScene,
    mishaps: tuple[Mishap, ...],
    reference_m: float,
) -> Row:
    """All that is kept of a route, as JSON has it.

    Scores and facts begin at the hand-over; times and the ego's track at the route's own begin.

    Args:
        order: The route.
        log: What happened.
        scene: The same, to be scored.
        mishaps: What went wrong.
        reference_m: See `score_rules`.
    """
    lawful, strict = (
        epdms(
            scene.ego,
            scene.others,
            around,
            reference_progress_m=reference_m,
            history=scene.history,
            plans=scene.plans,
        )
        for around in (scene.ground.lawful, scene.ground.strict)
    )
    facts = collect_facts(scene.ego, scene.others, scene.ground.lawful)
    driven = _bench2drive(lawful, facts, reference_m)
    return {
        **_heading(order, log.mode),
        "error": None,
        "scores": {"driving_score": lawful.total, **_sub_scores(lawful)},
        "strict_route": {"driving_score": strict.total, "ddc": strict.ddc},
        "bench2drive": {"score": driven.score, "success": float(driven.is_success)},
        "facts": _facts(scene, facts, log, reference_m),
        "contacts": _contacts(scene, facts),
        "mishaps": _mishaps(mishaps),
        "ego": _track(log),
        "plans": {
            "time_s": [time_s for time_s, _ in log.plans],
            "template": [plan.template_idx for _, plan in log.plans],
        },
    }


def failure_of(order: RouteOrder, mode: str, sentence: str) -> Row:
    """A route that could not be driven to its end: it counts 0.

    Args:
        order: The route.
        mode: See `Simulator`.
        sentence: Why.
    """
    zeros = dict.fromkeys(("driving_score", *SUB_SCORES), 0.0)
    return {
        **_heading(order, mode),
        "error": sentence,
        "scores": zeros,
        "strict_route": {"driving_score": 0.0, "ddc": 0.0},
        "bench2drive": {"score": 0.0, "success": 0.0},
    }


def _heading(order: RouteOrder, mode: str) -> Row:
    return {"route": order.index, "town": order.town, "town_seed": order.town_seed,
            "seed": order.seed, "mode": mode}  # fmt: skip


def _sub_scores(score: DrivingScore) -> Row:
    return {name: getattr(score, name) for name in SUB_SCORES}


def _bench2drive(score: DrivingScore, facts: Facts, reference_m: float) -> Bench2Drive:
    """The route is as long as what the rules got of it; only hits at fault are infractions."""
    share = score.progress_m / (COMPLETE_SHARE * reference_m) if reference_m > LITTLE_M else 1.0
    hit = [contact.kind for contact in facts.contacts if contact.is_at_fault]
    return bench2drive(share, hit, facts.red_lights)


def _facts(scene: RouteScene, facts: Facts, log: RouteLog, reference_m: float) -> Row:
    plain = {name: _rounded(value) for name, value in asdict(facts).items() if name != "contacts"}
    off_m = scene.ground.off_route_m(scene.ego)
    return {
        "collisions_at_fault": sum(contact.is_at_fault for contact in facts.contacts),
        "collisions": sum(contact.cause != "before the start" for contact in facts.contacts),
        **plain,
        "off_route_m": _rounded(off_m),
        "reference_progress_m": _rounded(reference_m),
        "void_gates": sum(plan.is_gate_void for _, plan in log.plans),
    }


def _contacts(scene: RouteScene, facts: Facts) -> list[Row]:
    return [
        {
            "with": scene.names[contact.other],
            "kind": contact.kind,
            "time_s": round((FIRST_STEP + contact.step) * scene.ego.dt_s, 6),
            "at_m": scene.ego.xy_m[contact.step].round(_MM).tolist(),
            "cause": contact.cause,
            "is_at_fault": contact.is_at_fault,
        }
        for contact in facts.contacts
    ]


def _mishaps(mishaps: tuple[Mishap, ...]) -> list[Row]:
    """What went wrong, in words."""
    return [
        {"time_s": one.time_s, "what": one.words, "at_m": one.xy_m.round(_MM).tolist()}
        for one in mishaps
    ]


def _track(log: RouteLog) -> Row:
    ego = log.ego
    return {
        "dt_s": log.dt_s,
        "xy_m": ego.xy_m.round(_MM).tolist(),
        "yaw_rad": ego.yaw_rad.round(_MRAD).tolist(),
        "speed_mps": ego.speed_mps.round(_MM).tolist(),
    }


def _rounded(value: float | int) -> float | int:
    return value if isinstance(value, int) else round(float(value), _MM)
