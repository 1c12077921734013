// The strike in space.

const GHOST = 0.04, GHOSTS = 6; // [s] between earlier postures shown, and how many

const stage = {
  canvas: byId("stage"),

  /** What moves ever, and the target: left, right, bottom, top [m]. */
  box: (() => {
    const x = [0, target[0] - radius, target[0] + radius], y = [0, target[1] - radius, target[1] + radius];
    for (let i = 0; i < t.length; i++) {
      for (const p of joints(q.map((angles) => angles[i]))) if (Number.isFinite(p[0])) { x.push(p[0]); y.push(p[1]); }
    }
    return [Math.min(...x), Math.max(...x), Math.min(...y), Math.max(...y)];
  })(),

  resize() {
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.context = surface(this.canvas, this.width, this.height);
    const [left, right, bottom, top] = this.box;
    const [room, above, below] = [52, 24, 44];
    this.scale = Math.min((this.width - 2 * room) / (right - left), (this.height - above - below) / (top - bottom));
    const x0 = this.width / 2 - (this.scale * (left + right)) / 2;
    const y0 = (above + this.height - below) / 2 + (this.scale * (bottom + top)) / 2;
    this.place = ([x, y]) => [x0 + this.scale * x, y0 - this.scale * y];
    this.grid = document.createElement("canvas");
    this.drawGrid(surface(this.grid, this.width, this.height), x0, y0);
  },

  drawGrid(c, x0, y0) {
    const { width, height, scale } = this;
    const step = roundStep(100 / scale);
    const xs = multiples(-x0 / scale, (width - x0) / scale, step);
    const ys = multiples((y0 - height) / scale, y0 / scale, step);
    const line = (x, ends) => stroke(c, ends, { strokeStyle: colors.line, lineWidth: Math.abs(x) < 1e-9 ? 2 : 1 });
    xs.forEach((x) => line(x, [[x0 + scale * x, 0], [x0 + scale * x, height]]));
    ys.forEach((y) => line(y, [[0, y0 - scale * y], [width, y0 - scale * y]]));
    c.textAlign = "center";
    for (const x of xs) {
      const at = x0 + scale * x;
      if (at > 50 && at < width - 105) write(c, tickText(x, step), at, height - 8, colors.panel);
    }
    c.textAlign = "left";
    for (const y of ys) {
      const at = y0 - scale * y;
      if (at > 34 && at < height - 26) write(c, tickText(y, step), 8, at - 4, colors.panel);
    }
    write(c, "y, up [m]", 8, 18, colors.panel);
    c.textAlign = "right";
    write(c, "x, forward [m]", width - 8, height - 8, colors.panel);
  },

  draw() {
    const { context: c, place } = this;
    const { i, f } = state.at;
    c.clearRect(0, 0, this.width, this.height);
    c.drawImage(this.grid, 0, 0, this.width, this.height);

    // The target: dashed and orange, whole and green once it is hit
    const struck = state.t >= hitTime, mark = struck ? colors.green : colors.orange;
    c.globalAlpha = 0.28;
    disc(c, place(target), this.scale * radius, mark);
    Object.assign(c, { globalAlpha: 1, lineWidth: 2 });
    c.setLineDash(struck ? [] : [5, 5]);
    disc(c, place(target), this.scale * radius, null, mark);
    c.setLineDash([]);
    disc(c, place(target), 2.5, mark);

    // The tip's path: what is to come dotted, what was the redder the faster
    const path = t.map((_, k) => place([tip[0][k], tip[1][k]]));
    const now = joints(q.map((angles) => value(angles, state.at))).map(place);
    const end = place([value(tip[0], state.at), value(tip[1], state.at)]);
    stroke(c, [end, ...path.slice(i + 1)], { strokeStyle: colors.slow, dash: [1, 5], lineWidth: 1.8 });
    const past = [...path.slice(0, i + 1), end], fastest = Math.max(...strike.speed);
    stroke(c, past, { strokeStyle: colors.slow, lineWidth: 2.6 });
    for (let k = 0; k + 1 < past.length; k++) {
      const share = strike.speed[Math.min(k + 1, t.length - 1)] / fastest;
      stroke(c, [past[k], past[k + 1]], { strokeStyle: colors.vermilion, lineWidth: 2.6, globalAlpha: share ** 1.5 });
    }

    // Where the whip was, the fainter the longer ago
    for (let k = 1; k <= GHOSTS; k++) {
      const before = (Math.ceil(state.t / GHOST - 1e-9) - k) * GHOST;
      if (before < start) break;
      const posture = joints(q.map((angles) => value(angles, locate(before)))).map(place);
      const age = (state.t - before) / (GHOST * (GHOSTS + 1));
      stroke(c, posture.slice(arm), { strokeStyle: colors.whip, lineWidth: 1.6, globalAlpha: 0.3 * (1 - age) });
      stroke(c, posture.slice(0, arm + 1), { strokeStyle: colors.blue, lineWidth: 3, globalAlpha: 0.3 * (1 - age) });
    }

    // Whip and arm, the desired arm upon it
    const whip = now.slice(arm);
    for (let k = 0; k + 1 < whip.length; k++) {
      const width = 4.2 - (2.2 * k) / whip.length;
      stroke(c, [whip[k], whip[k + 1]], { strokeStyle: colors.whip, lineWidth: width });
    }
    whip.slice(1, -1).forEach((p) => disc(c, p, 2.6, colors.whip));
    stroke(c, now.slice(0, arm + 1), { strokeStyle: colors.blue, lineWidth: 8 });
    const desired = joints(q_d.map((angles) => value(angles, state.at))).map(place);
    stroke(c, desired, { strokeStyle: colors.ink, lineWidth: 1.4, dash: [4, 4] });
    c.lineWidth = 2;
    now.slice(0, arm + 1).forEach((p) => disc(c, p, 4.5, colors.paper, colors.whip));
    disc(c, end, 5.5, colors.vermilion, colors.panel);
    if (near) {
      c.lineWidth = 1.6;
      disc(c, place(near.tip), 8.5, null, colors.vermilion);
    }
  },
};
