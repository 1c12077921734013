"""Fits bending stiffness and damping of a hanging rope with dismech-newton (GPL-3), in a separate environment.

`python dismech_rope.py GIVEN.npz FOUND.npz`: `benchmarks/ropes.py` writes the former and reads the latter. Gradients of
the squared error go back through the solver's steps, and L-BFGS follows them from the given first guess.
"""

import sys
import time

import newton
import numpy as np
import warp as wp
from dismech_newton import DiSMechSolver, add_rod, flatten_state, suspended_tape
from dismech_newton.strains import vec10f
from scipy.optimize import minimize


@wp.kernel
def set_bending(logs: wp.array[float], base: wp.array[vec10f], params: wp.array[vec10f]):
    i = wp.tid()
    p = base[i]
    k = wp.exp(logs[0])
    c = wp.exp(logs[1])
    params[i] = vec10f(p[0], p[1], k, k, p[4], p[5], p[6], c, c, p[9])


@wp.kernel
def set_hands(nodes: wp.array[wp.int32], places: wp.array2d[float], step: int, q: wp.array[float]):
    i = wp.tid()
    for axis in range(3):
        q[3 * nodes[i] + axis] = places[step, 3 * i + axis]


@wp.kernel
def add_squares(x: wp.array[wp.vec3], seen: wp.array[wp.vec3], which: wp.array[wp.int32], loss: wp.array[float]):
    i = wp.tid()
    wp.atomic_add(loss, 0, wp.length_sq(x[which[i]] - seen[i]))


class Ropes:
    """Ropes of one material whose upper ends follow given paths.

    Args:
        given: Numbers of the rope and of the simulation.
        hands: Places of the R hands at the start and in the middle of every step, and then at its end,
            (2, S + 1, R, 3) [m].
    """

    def __init__(self, given, hands, *, grad):
        hands, ends = hands
        self.segments, self.h, self.hands = int(given["segments"]), float(given["h"]), hands
        self.every, self.markers = int(given["every"]), given["markers"]
        length, mass, count = float(given["length"]), float(given["density"]), hands.shape[1]
        radius = 0.004
        cfg = newton.ModelBuilder.ShapeConfig(density=mass / (np.pi * radius**2))
        builder = newton.ModelBuilder(gravity=(0.0, 0.0, -float(given["gravity"])))
        for r in range(count):
            top = hands[0, r]
            rod = newton.Rod.create_straight(
                tuple(top), (0.0, 0.0, -1.0), length, segment_count=self.segments, radius=radius
            )
            stretch = float(given["stretch"])
            add_rod(
                builder, rod, cfg=cfg, stretch_stiffness=stretch, bend_stiffness=1.0, bend_damping=1.0, proxies=False
            )
        self.tops = np.arange(count) * (self.segments + 1)
        for top in self.tops:
            builder.particle_flags[top] &= ~newton.ParticleFlags.ACTIVE
        self.model = builder.finalize(device="cpu")
        self.solver = DiSMechSolver(self.model, theta=0.5)
        self.params = self.model.dismech.triplet_params
        self.base = wp.clone(self.params)
        self.params.requires_grad = grad
        self.logs = wp.zeros(2, dtype=float, requires_grad=grad)
        self.states = [self.model.state(requires_grad=grad) for _ in range(len(hands) if grad else 2)]
        for state in self.states:
            flatten_state(state)
        self.first = [a.numpy() for a in (self.states[0].dismech.q, self.states[0].dismech.qd)]
        self.places, self.ends = (
            wp.array(x.reshape(len(x), -1).astype(np.float32), dtype=float) for x in (hands, ends)
        )
        self.nodes = wp.array(self.tops.astype(np.int32), dtype=wp.int32)
        self.which = wp.array((self.tops[:, None] + self.markers).ravel().astype(np.int32), dtype=wp.int32)
        self.loss = wp.zeros(1, dtype=float, requires_grad=grad)

    def put(self, places, step, state):
        """Move the hands of a state to places of a step."""
        with suspended_tape():
            inputs = [self.nodes, places, step]
            wp.launch(set_hands, dim=len(self.nodes), inputs=inputs, outputs=[state.dismech.q])

    def run(self, seen=None):
        """Return places of the markers at recorded frames, (F, R, M, 3), or add their squared errors to the loss."""
        found = []
        wp.launch(set_bending, dim=len(self.params), inputs=[self.logs, self.base], outputs=[self.params])
        for i in range(len(self.hands) - 1):
            now, then = self.states[i % len(self.states)], self.states[(i + 1) % len(self.states)]
            self.put(self.places, i + 1, now)
            self.solver.step(now, then, None, None, self.h)
            with suspended_tape():  # a step leaves the hand where it was in its middle, and measures the bending there
                self.put(self.ends, i + 1, then)
                self.solver.triplets.end_step(now, then)
            if (i + 1) % self.every:
                continue
            if seen is None:
                found.append(then.particle_q.numpy()[self.which.numpy()].reshape(len(self.tops), -1, 3))
            else:
                inputs = [then.particle_q, seen[(i + 1) // self.every - 1], self.which]
                wp.launch(add_squares, dim=len(self.which), inputs=inputs, outputs=[self.loss])
        return np.array(found)


def main(given_file, found_file):
    given = dict(np.load(given_file))
    link = float(given["length"]) / int(given["segments"])
    ropes = Ropes(given, given["hands"], grad=True)
    seen = [wp.array(x.reshape(-1, 3).astype(np.float32), dtype=wp.vec3) for x in given["seen"]]  # (F, R, M, 3)
    evaluations = 0

    best = [np.inf, np.log(given["guess"] / link)]

    def cost(logs):
        """The squared error and its gradient; a wall around the best values where the simulation fails."""
        nonlocal evaluations
        evaluations += 1
        ropes.logs.assign(logs.astype(np.float32))
        ropes.loss.zero_()
        for state in ropes.states:  # a failed simulation leaves nothing behind
            state.dismech.q.assign(ropes.first[0])
            state.dismech.qd.assign(ropes.first[1])
        tape = wp.Tape()
        try:
            with tape:
                ropes.run(seen)
            tape.backward(ropes.loss)
            value, slope = float(ropes.loss.numpy()[0]), ropes.logs.grad.numpy().astype(float)
        except RuntimeError as failed:
            print(f"  {np.exp(logs) * link}: {failed}", file=sys.stderr, flush=True)
            value, slope = np.inf, logs
        tape.zero()
        scale = 1 / float(given["sigma"]) ** 2
        if not (np.isfinite(value) and np.isfinite(slope).all()):
            away = logs - best[1]
            return best[0] * (1 + 10 * away @ away), 20 * best[0] * away
        if value * scale < best[0]:
            best[:] = value * scale, logs.copy()
        print(f"  {np.exp(logs) * link}: {value * scale:.1f}", file=sys.stderr, flush=True)
        return value * scale, slope * scale

    start = np.log(given["guess"] / link)
    cost(start)  # compiles before the clock starts
    began, evaluations = time.process_time(), 0
    limits = [(x - np.log(20), x + np.log(20)) for x in start]
    minimize(cost, start, jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": int(given["iterations"])})
    seconds = time.process_time() - began
    outside = Ropes(given, given["held_out_hands"], grad=False)
    values = best[1]
    outside.logs.assign(values.astype(np.float32))
    predicted = outside.run()
    np.savez(found_file, values=np.exp(values) * link, seconds=seconds, predicted=predicted, evaluations=evaluations)


if __name__ == "__main__":
    main(*sys.argv[1:])
