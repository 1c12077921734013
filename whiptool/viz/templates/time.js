// The strike over time: plots with one time axis and one cursor.

const MARGIN = { left: 52, right: 18, top: 5, bottom: 5, axis: 32 };

/** A power of ten, or 0. */
const power = (x) => {
  if (!x) return "0";
  const size = Math.round(Math.log10(Math.abs(x)));
  return size < -2 || size > 3 ? exponential(x, 0) : fixed(x, Math.max(0, -size));
};

/** Values as heights: linear, or logarithmic beyond a threshold where they span decades. */
function makeScale(series, { fromZero = false, decades = false, extra = 0 }) {
  const all = series.flatMap((s) => s.values).filter((x) => x !== null);
  let [low, high] = all.reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]);
  if (!all.length) [low, high] = [0, 1];
  const largest = t.map((_, k) => Math.max(...series.map((s) => Math.abs(s.values[k] ?? 0)))).sort((a, b) => a - b);
  const [usual, peak] = [largest[largest.length >> 1], largest[largest.length - 1]];
  if (decades && usual < peak / 10) {
    const linear = 10 ** Math.floor(Math.log10(Math.max(usual, peak / 1e3)));
    const far = (size) => (size <= 1 ? size : 1 + Math.log10(size));
    const to = (x) => Math.sign(x) * far(Math.abs(x) / linear);
    const powers = [];
    for (let x = linear; x <= peak; x *= 10) powers.unshift(x, -x);
    const marks = [0, ...powers]; // the first are named where there is no room for all
    [low, high] = [Math.min(to(low), 0), Math.max(to(high), 0)];
    const pad = 0.06 * (high - low);
    return { to, low: low - (low < 0 ? pad : 0), high: high + pad, read: short,
      marks: () => marks.filter((x) => to(x) >= low && to(x) <= high + pad).map((x) => [x, power(x)]) };
  }
  if (fromZero) low = Math.min(low, 0);
  if (high - low < 1e-9) [low, high] = [low - 1, high + 1];
  const pad = 0.07 * (high - low);
  [low, high] = [fromZero && low === 0 ? 0 : low - pad, high + pad];
  const digits = Math.max(0, extra + 3 - Math.ceil(Math.log10(peak || 1)));
  const name = (x, step) => (high - low < 1e4 ? tickText(x, step) : short(x));
  const marks = (height) => {
    const step = roundStep((26 * (high - low)) / height);
    return multiples(low, high, step).map((x) => [x, name(x, step)]);
  };
  return { to: (x) => x, low, high, marks, read: (x) => (peak < 1e4 ? fixed(x, digits) : short(x)) };
}

class Plot {
  constructor({ title, unit, series, zone = null, dot = null, last = false, ...scale }) {
    Object.assign(this, { series, zone, dot, last, scale: makeScale(series, scale) });
    this.figure = document.createElement("figure");
    const caption = this.figure.appendChild(document.createElement("figcaption"));
    caption.append(Object.assign(document.createElement("b"), { textContent: `${title} [${unit}]` }));
    for (const s of series) {
      const entry = caption.appendChild(document.createElement("span"));
      const line = entry.appendChild(document.createElement("i"));
      line.style.borderTopColor = `var(--${s.color})`;
      line.className = s.dash ? "dashed" : "";
      entry.append(s.name);
      if (s.sub) entry.append(Object.assign(document.createElement("sub"), { textContent: s.sub }));
      s.shown = document.createElement("output");
      s.shown.setAttribute("aria-live", "off");
      s.shown.style.minWidth = `${Math.max(...s.values.map((x) => this.scale.read(x ?? 0).length))}ch`; // nothing jumps
      entry.append(" ", s.shown);
    }
    this.canvas = this.figure.appendChild(document.createElement("canvas"));
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${title} over time`);
    const seekTo = (event) => {
      const share = (event.offsetX - MARGIN.left) / (this.width - MARGIN.left - MARGIN.right);
      seek(start + share * (end - start));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      pause();
      this.canvas.setPointerCapture(event.pointerId);
      seekTo(event);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && seekTo(event));
    this.canvas.addEventListener("pointerup", remember);
    byId("plots").append(this.figure);
  }

  resize() {
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.context = surface(this.canvas, this.width, this.height);
    this.bottom = this.height - MARGIN.bottom - (this.last ? MARGIN.axis : 0);
    const { low, high, to } = this.scale;
    this.x = (time) => MARGIN.left + ((this.width - MARGIN.left - MARGIN.right) * (time - start)) / (end - start || 1);
    this.y = (x) => this.bottom - ((this.bottom - MARGIN.top) * (to(x) - low)) / (high - low);
    this.still = document.createElement("canvas");
    this.drawStill(surface(this.still, this.width, this.height));
  }

  /** Axes and lines: all that does not move with time. */
  drawStill(c) {
    const [left, right, top, bottom] = [MARGIN.left, this.width - MARGIN.right, MARGIN.top, this.bottom];
    c.fillStyle = colors.faint;
    c.textAlign = "right";
    const named = [];
    for (const [x, name] of this.scale.marks(bottom - top)) {
      stroke(c, [[left, this.y(x)], [right, this.y(x)]], { strokeStyle: colors.line });
      if (named.some((y) => Math.abs(y - this.y(x)) < 13)) continue;
      c.fillText(name, left - 7, this.y(x) + 4);
      named.push(this.y(x));
    }
    const step = roundStep((90 * (end - start || 1)) / this.width);
    for (const time of multiples(start, end, step)) {
      stroke(c, [[this.x(time), top], [this.x(time), bottom]], { strokeStyle: colors.line });
      c.textAlign = "center";
      if (this.last) c.fillText(tickText(time, step), this.x(time), bottom + 16);
    }
    c.textAlign = "right";
    if (this.last) c.fillText("time [s]", right, bottom + 31);
    if (this.zone !== null) {
      const edge = this.y(this.zone);
      Object.assign(c, { fillStyle: colors.orange, globalAlpha: 0.25 });
      c.fillRect(left, edge, right - left, bottom - edge);
      stroke(c, [[left, edge], [right, edge]], { strokeStyle: colors.orange, lineWidth: 1.4, dash: [6, 4] });
    }
    if (strike.D !== null) {
      const x = this.x(strike.D);
      stroke(c, [[x, top], [x, bottom]], { strokeStyle: colors.faint, dash: [1, 4], lineWidth: 1.4 });
    }
    if (near) {
      const x = this.x(near.time);
      stroke(c, [[x, top], [x, bottom]], { strokeStyle: colors.vermilion, globalAlpha: 0.55, dash: [3, 4] });
    }
    c.save();
    c.beginPath();
    c.rect(left, top - 3, right - left, bottom - top + 6);
    c.clip();
    for (const s of this.series) {
      const known = s.values.map((x, k) => [x, k]).filter(([x]) => x !== null);
      stroke(c, known.map(([x, k]) => [this.x(t[k]), this.y(x)]), {
        strokeStyle: colors[s.color], lineWidth: s.dash ? 1.4 : 2, dash: s.dash, shift: s.shift,
      });
    }
    c.restore();
    c.textAlign = "left";
    if (strike.D !== null) write(c, "D", this.x(strike.D) + 4, top + 10, colors.paper);
    if (this.dot) disc(c, [this.x(this.dot[0]), this.y(this.dot[1])], 4.5, colors.vermilion);
  }

  draw() {
    const c = this.context, x = this.x(state.t);
    c.clearRect(0, 0, this.width, this.height);
    c.drawImage(this.still, 0, 0, this.width, this.height);
    stroke(c, [[x, MARGIN.top - 4], [x, this.bottom]], { strokeStyle: colors.ink, lineWidth: 1.2 });
    c.lineWidth = 1.5;
    for (const s of this.series) {
      const here = value(s.values, state.at);
      if (Number.isFinite(here) && s.values[state.at.i] !== null && !s.dash) {
        disc(c, [x, this.y(here)], 3.6, colors[s.color], colors.paper);
      }
      s.shown.textContent = s.values[state.at.i] === null ? "\u2013" : this.scale.read(here);
    }
  }
}

const CYCLE = ["blue", "vermilion", "green", "pink", "orange", "sky"];
/** Positions of joint k in deg, or in mm where it slides. */
const positions = (values, k) => values.map((x) => (x === null ? null : (strike.slides[k] ? 1e3 : 180 / Math.PI) * x));
const cycle = (k) => CYCLE[k % CYCLE.length];
const ofJoint = (k) => [...CYCLE, "brown"][k % (CYCLE.length + 1)];
const perJoint = (rows) => rows.map((values, k) => ({ name: strike.joints[k], values, color: ofJoint(k) }));
const gains = (name, rows) => rows.map((values, k) => {
  const [i, j] = rows.length === arm ? [k, k] : [Math.floor(k / arm), k % arm]; // the diagonal, or all row by row
  const dash = i === j ? null : [5, 5], shift = i > j ? 5 : 0; // equal entries show in turn
  return { name, sub: strike.marks[i] + strike.marks[j], values, color: (rows.length === arm ? ofJoint : cycle)(k), dash, shift };
});
const moves = (rows) => rows.some((values) => values.some((x) => x)); // what is zero throughout is not shown
const follows = q_d.every((values, k) => values.every((x, i) => x === q[k][i])); // the arm, its references exactly
const plots = [
  { title: "Tip speed", unit: "m/s", series: [{ name: "tip", values: strike.speed, color: "blue" }], fromZero: true },
  { title: "Distance to target", unit: "m", series: [{ name: "tip to target", values: strike.distance, color: "blue" }],
    fromZero: true, extra: 1, zone: radius, dot: near && [near.time, near.distance] },
  { title: strike.slides.includes(true) ? "Positions" : "Angles", unit: strike.units.q,
    series: perJoint(q.slice(0, arm).map(positions)).flatMap((joint, k) => [
      joint, ...(follows ? [] : [{ name: "desired", values: positions(q_d[k], k), color: "black", dash: [5, 3] }])]) },
  { title: "Torque", unit: strike.units.tau, series: perJoint(strike.tau), decades: true },
  ...(moves(strike.K) ? [{ title: "Stiffness K", unit: strike.units.K, series: gains("K", strike.K), decades: true }] : []),
  ...(moves(strike.B) ? [{ title: "Damping B", unit: strike.units.B, series: gains("B", strike.B), decades: true }] : []),
].map((about, k, all) => new Plot({ ...about, last: k === all.length - 1 }));
root.style.setProperty("--plots", plots.length);
