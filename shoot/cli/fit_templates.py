"""shoot-fit-templates: K templates, fitted to ego futures or taken from a vocabulary."""

from pathlib import Path

from lss_core.data.usable import LEFT_OUT, save_left_out
from lss_core.errors import DataError
from lss_core.files import check_writable
from shoot.cli.app import run
from shoot.cli.template_settings import DataSource, FitTemplatesConfig, NumTemplates
from shoot.cli.templates_on_data import MadeTemplates, templates_on_data
from shoot.rendering import render_templates, save_figure
from shoot.templates import TemplateSet, read_vocabulary, write_vocabulary

__all__ = ["DataSource", "FitTemplatesConfig", "NumTemplates", "fit", "main"]


def fit(config: FitTemplatesConfig) -> TemplateSet:
    """Make templates, save file, card and picture, and report.

    Raises:
        DataError: If the data or the vocabulary is not as it should be, there are too few
            trajectories, or a scene of the other split shares a drive with one that is fitted on.
        OSError: If a file cannot be written.
    """
    out = Path(config.out)
    for path, suffix in ((config.out, ".npz"), (config.export, ".npy")):
        if path is not None and Path(path).suffix != suffix:
            what = "template file" if suffix == ".npz" else "exported vocabulary"
            raise DataError(f"The {what} must end in {suffix}, got '{path}'.")
        if path is not None:
            check_writable(path)
    given = None if config.vocabulary is None else _read_vocabulary(config)
    if given is None or config.data.root is not None:
        made = templates_on_data(config, given)
    else:
        made = _without_data(given)
    templates = made.templates
    save_left_out(out.with_suffix(f".{LEFT_OUT}"), {config.split: made.left_out})
    figure = render_templates(templates.points, templates.counts, templates.dt_s)
    save_figure(figure, out.with_suffix(".png"))
    templates.save(out)
    if made.coverage:
        print("Distance of a future to its nearest template (mean over its points, m):")
        print(f"  {'split':8} {'futures':>8} {'mean':>6} {'median':>6} {'95 %':>6} {'max':>6}")
    for name, value in made.coverage.items():
        print(
            f"  {name:8} {value.count:8d} {value.mean_m:6.2f} {value.median_m:6.2f} "
            f"{value.p95_m:6.2f} {value.max_m:6.2f}"
        )
    if made.left_out:
        print(f"Left out {len(made.left_out)} scenes, listed in {out.stem}.{LEFT_OUT}.")
    num = len(templates.points)
    print(f"Wrote {num} templates to {out} (card {out.stem}.json, picture {out.stem}.png).")
    if config.export is not None:
        write_vocabulary(config.export, templates)
        print(f"Exported: {config.export}")
    return templates


def _read_vocabulary(config: FitTemplatesConfig) -> TemplateSet:
    templates = read_vocabulary(str(config.vocabulary), config.step_s)
    if config.horizon_s is not None and abs(config.horizon_s - templates.horizon_s) > 1e-9:
        raise DataError(
            f"'{config.vocabulary}' has {templates.points.shape[1]} points, at {config.step_s:g} s "
            f"each {templates.horizon_s:g} s in all, not {config.horizon_s:g} s (--horizon-s)."
        )
    return templates


def _without_data(given: TemplateSet) -> MadeTemplates:
    """A vocabulary as it is."""
    print(
        f"Took {len(given.points)} templates of {given.horizon_s:g} s; without --data.root no "
        "futures are counted."
    )
    return MadeTemplates(given, {}, [])


def main() -> None:
    """Entry point."""
    run(
        FitTemplatesConfig,
        fit,
        "Fit K templates to ego futures, by K-Means or otherwise, or take a vocabulary.",
    )
