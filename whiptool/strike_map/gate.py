"""Gate: the network that says which of a goal's candidates hits.

Each answer with its derivatives is an expert on goals nearby, and a goal has many: the gate is that of a mixture of
experts (Jacobs, Jordan, Nowlan and Hinton 1991), trained on what candidates came to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.extras import optional
from whiptool.progress import Progress

HIDDEN = (256, 256)
_EPOCHS, _BATCH, _RATE, _DECAY = 40, 512, 1e-3, 1e-4
_HELD_OUT = 10  # every so many goals are held out


@dataclass(frozen=True, eq=False)
class Gate:
    """A trained ranking network (gate) that predicts which candidates hit: a multilayer perceptron, evaluated with
    NumPy.

    Args:
        weights, biases: Weights and biases of each layer, (in, out) and (out,), in single precision.
        mean, scale: Mean and scale of the features that it was trained on, (f,) each.
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    mean: np.ndarray
    scale: np.ndarray

    def odds(self, seen: np.ndarray) -> np.ndarray:
        """Return the log odds that candidates hit, (C,), from their features (C, f)."""
        x = _scaled(seen, self.mean, self.scale)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.maximum(x @ weight + bias, 0.0)
        return (x @ self.weights[-1] + self.biases[-1])[:, 0].astype(float)

    @classmethod
    def trained(cls, seen: np.ndarray, hit: np.ndarray, *, seed: int, progress: bool = False) -> Gate:
        """Return a network trained by logistic regression on the features (N, f) of candidates and whether they hit,
        (N,).
        """
        torch = optional("torch", "the gate of a strike map")
        from whiptool.rl.networks import Layers

        generator = torch.Generator().manual_seed(seed)
        mean, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-6
        layers = Layers([seen.shape[1], *HIDDEN, 1], generator)
        x, y = torch.as_tensor(_scaled(seen, mean, scale)), torch.as_tensor(hit, dtype=torch.float32)
        optimizer = torch.optim.AdamW(layers.parameters(), lr=_RATE, weight_decay=_DECAY)
        steps = _EPOCHS * -(-len(x) // _BATCH)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        for _ in Progress(range(_EPOCHS), desc="gate", disable=not progress, leave=False):
            for rows in torch.randperm(len(x), generator=generator).split(_BATCH):
                loss = torch.nn.functional.binary_cross_entropy_with_logits(layers(x[rows])[0, :, 0], y[rows])
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()
        weights, biases = (
            tuple(part.detach().numpy().squeeze(axis) for part in parts)
            for parts, axis in ((layers.weights, 0), (layers.biases, (0, 1)))
        )
        return cls(weights, biases, mean, scale)


def _scaled(seen: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return ((seen - mean) / scale).astype(np.float32)
