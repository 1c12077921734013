// The strike in space.

const GHOST = 0.04, GHOSTS = 6; // [s] between earlier postures shown, and how many

const stage = {
  canvas: byId("stage"),

  /** What moves ever, and the target: lowest and highest of each coordinate [m]. */
  extent: target.map((x, c) => {
    let [low, high] = [Math.min(0, x - radius), Math.max(0, x + radius)];
    for (let i = 0; i < t.length; i++) {
      for (const p of posture({ i, f: 0 })) {
        if (Number.isFinite(p[c])) { low = Math.min(low, p[c]); high = Math.max(high, p[c]); }
      }
    }
    return [low, high];
  }),

  /** Left, right, bottom, top [m] of what is seen: in space about its middle, the same from everywhere. */
  get box() {
    if (!inSpace) return [...this.extent[0], ...this.extent[1]];
    return [-1, 1, -1, 1].map((end) => 0.8 * end * orbit.half);
  },

  resize() {
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.context = surface(this.canvas, this.width, this.height);
    this.look();
  },

  /** Set scale and grid by what is seen from here. */
  look() {
    if (inSpace) orbit.fit(this.extent);
    const [left, right, bottom, top] = this.box;
    const [room, above, below] = [52, 24, 44];
    const across = (this.width - 2 * room) / (right - left), up = (this.height - above - below) / (top - bottom);
    this.scale = Math.max(Math.min(across, up), 1); // [pixels/m]; a frame that is not laid out has no room
    const x0 = this.width / 2 - (this.scale * (left + right)) / 2;
    const y0 = (above + this.height - below) / 2 + (this.scale * (bottom + top)) / 2;
    this.place = ([x, y]) => [x0 + this.scale * x, y0 - this.scale * y];
    if (inSpace) {
      this.scale *= orbit.zoom;
      this.middle = [x0, y0];
      this.place = (point) => {
        const [x, y] = orbit.seen(point);
        return [x0 + orbit.shift[0] + this.scale * x, y0 + orbit.shift[1] - this.scale * y];
      };
    }
    this.grid = document.createElement("canvas");
    const grid = surface(this.grid, this.width, this.height);
    if (inSpace) this.drawFloor(grid); else this.drawGrid(grid, x0, y0);
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

  /** A grid below all that moves, and where the axes point. */
  drawFloor(c) {
    const [xs, ys, [floor]] = this.extent, step = roundStep(0.25 * orbit.half);
    const [left, right, near, far] = [...xs, ...ys].map((x, k) => (k % 2 ? Math.ceil : Math.floor)(x / step) * step);
    const style = { strokeStyle: colors.line };
    for (const x of multiples(left, right, step)) stroke(c, [[x, near, floor], [x, far, floor]].map(this.place), style);
    for (const y of multiples(near, far, step)) stroke(c, [[left, y, floor], [right, y, floor]].map(this.place), style);
    [["x, forward", [1, 0, 0]], ["y, left", [0, 1, 0]], ["z, up", [0, 0, 1]]].forEach(([name, way]) => {
      const ends = [[0, 0, 0], way.map((x) => x * step)].map(this.place);
      stroke(c, ends, { strokeStyle: colors.faint, lineWidth: 1.4 });
      c.textAlign = ends[1][0] < ends[0][0] ? "right" : "left";
      if (Math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]) > 12) write(c, name, ...ends[1], colors.panel);
    });
    c.textAlign = "left";
    const view = orbit.flat ? orbit.name : `from ${fixed(orbit.around, 0)}\u00b0, ${fixed(orbit.above, 0)}\u00b0 above`;
    write(c, `grid ${tickText(step, step)} m, ${view}`, 8, this.height - 8, colors.panel);
  },

  draw() {
    const { context: c, place } = this;
    const { i, f } = state.at;
    c.clearRect(0, 0, this.width, this.height);
    c.drawImage(this.grid, 0, 0, this.width, this.height);

    // The target: dashed and orange, whole and green once it is hit
    const struck = state.t >= hitTime, mark = struck ? colors.green : colors.orange;
    const size = this.scale * radius * (inSpace ? orbit.seen(target)[2] : 1);
    c.globalAlpha = 0.28;
    disc(c, place(target), size, mark);
    Object.assign(c, { globalAlpha: 1, lineWidth: 2 });
    c.setLineDash(struck ? [] : [5, 5]);
    disc(c, place(target), size, null, mark);
    c.setLineDash([]);
    disc(c, place(target), 2.5, mark);

    // The tip's path: what is to come dotted, what was the redder the faster
    const path = t.map((_, k) => place(tip.map((series) => series[k])));
    const now = posture(state.at).map(place);
    const end = place(tipAt(state.at));
    stroke(c, [end, ...path.slice(i + 1)], { strokeStyle: colors.slow, dash: [1, 5], lineWidth: 1.8 });
    const past = [...path.slice(0, i + 1), end], fastest = Math.max(...strike.speed);
    stroke(c, past, { strokeStyle: colors.slow, lineWidth: 2.6 });
    for (let k = 0; k + 1 < past.length; k++) {
      const share = strike.speed[Math.min(k + 1, t.length - 1)] / fastest;
      stroke(c, [past[k], past[k + 1]], { strokeStyle: colors.vermilion, lineWidth: 2.6, globalAlpha: share ** 1.5 });
    }

    if (inSpace) {
      const floor = this.extent[2][0], shadow = posture(state.at).map(([x, y]) => place([x, y, floor]));
      stroke(c, shadow.slice(arm), { strokeStyle: colors.slow, lineWidth: 1.6, globalAlpha: 0.5 });
      stroke(c, shadow.slice(0, arm + 1), { strokeStyle: colors.slow, lineWidth: 4, globalAlpha: 0.5 });
      stroke(c, [place(target), place([target[0], target[1], floor])], { strokeStyle: mark, dash: [1, 4] });
    }

    // Where the whip was, the fainter the longer ago
    for (let k = 1; k <= GHOSTS; k++) {
      const before = (Math.ceil(state.t / GHOST - 1e-9) - k) * GHOST;
      if (before < start) break;
      const then = posture(locate(before)).map(place);
      const age = (state.t - before) / (GHOST * (GHOSTS + 1));
      stroke(c, then.slice(arm), { strokeStyle: colors.whip, lineWidth: 1.6, globalAlpha: 0.3 * (1 - age) });
      stroke(c, then.slice(0, arm + 1), { strokeStyle: colors.blue, lineWidth: 3, globalAlpha: 0.3 * (1 - age) });
    }

    // Whip and arm, the desired arm upon it
    const whip = now.slice(arm);
    for (let k = 0; k + 1 < whip.length; k++) {
      const width = 4.2 - (2.2 * k) / whip.length;
      stroke(c, [whip[k], whip[k + 1]], { strokeStyle: colors.whip, lineWidth: width });
    }
    whip.slice(1, -1).forEach((p) => disc(c, p, 2.6, colors.whip));
    const base = inSpace ? [place([0, 0, 0])] : [];
    stroke(c, [...base, ...now.slice(0, arm + 1)], { strokeStyle: colors.blue, lineWidth: 8 });
    const desired = desiredArm(state.at).map(place);
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
