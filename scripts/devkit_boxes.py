"""Draw annotated boxes on a synthetic data set with nuscenes-devkit's own, unmodified renderer.

    python scripts/devkit_boxes.py DATA_ROOT OUT.png

Shows the six cameras of the sample with the most cars near the ego: a check by eye that images,
calibration, poses and annotations fit together.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from nuscenes.nuscenes import NuScenes

ORDER = ("FRONT_LEFT", "FRONT", "FRONT_RIGHT", "BACK_LEFT", "BACK", "BACK_RIGHT")
NEAR_M = (6.0, 25.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    nusc = NuScenes("v1.0-trainval", str(arguments.root), verbose=False)
    by_day = [s["token"] for s in nusc.scene if not {"Night", "Rain", "Dusk"} & words(s)]
    samples = [s for s in nusc.sample if s["scene_token"] in by_day]
    sample = max(samples, key=lambda s: num_near_cars(nusc, s))
    figure, axes = plt.subplots(2, 3, figsize=(12, 4.8), layout="constrained")
    for axis, name in zip(axes.flat, ORDER, strict=True):
        nusc.render_sample_data(sample["data"][f"CAM_{name}"], ax=axis, verbose=False)
        axis.set_title(name.replace("_", " ").lower(), fontsize=9)
    figure.savefig(arguments.out, dpi=100)
    print(arguments.out)


def words(scene: dict[str, str]) -> set[str]:
    return set(scene["description"].replace(",", "").split())


def num_near_cars(nusc: NuScenes, sample: dict[str, str]) -> int:
    ego = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])["ego_pose_token"]
    place = np.array(nusc.get("ego_pose", ego)["translation"])
    boxes = [nusc.get("sample_annotation", token) for token in sample["anns"]]
    gaps_m = [
        float(np.linalg.norm(np.array(box["translation"]) - place))
        for box in boxes
        if box["category_name"].startswith("vehicle")
    ]
    return sum(NEAR_M[0] < gap < NEAR_M[1] for gap in gaps_m)


if __name__ == "__main__":
    main()
