"""Reads what data_set.py wrote into PyTorch, and shows a batch's shapes.

python read_data_set.py views
"""

import json
import sys
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset


class Views(Dataset[dict[str, torch.Tensor]]):
    """The images of a folder, channels first, with their poses."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.views = json.loads((self.folder / "poses.json").read_text())["views"]

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        with np.load(self.folder / f"{index:05}.npz") as arrays:
            view = {name: torch.from_numpy(array.astype(np.float32)) for name, array in arrays.items()}
        view = {name: image.movedim(-1, 0) if image.ndim == 3 else image[None] for name, image in view.items()}
        view["pose"] = torch.tensor(self.views[index]["world_from_camera"])
        return view


if __name__ == "__main__":
    batch = next(iter(DataLoader(Views(sys.argv[1]), batch_size=8, shuffle=True)))
    print({name: tuple(tensor.shape) for name, tensor in batch.items()})
