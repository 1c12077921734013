"use strict";
// What the page knows: the strike, the instant that is shown, and values there.
const root = document.documentElement;
const byId = (id) => document.getElementById(id);

// An error is shown, and marked where programs can see it
addEventListener("error", (event) => {
  root.dataset.error = event.message;
  byId("failure").hidden = false;
  byId("failure").textContent = `This page failed: ${event.message}`;
});

const strike = JSON.parse(byId("strike").textContent);
const { t, q, q_d, tip, near, target, hit_radius: radius, arm, lengths } = strike;
const [start, end] = [t[0], t[t.length - 1]];
const state = { t: near ? near.time : start, playing: false, at: { i: 0, f: 0 } };

/** The sample before an instant, and the share of the way to the next. */
function locate(time) {
  let [low, high] = [0, t.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= time) low = middle; else high = middle;
  }
  return { i: low, f: high > low ? Math.min(Math.max((time - t[low]) / (t[high] - t[low]), 0), 1) : 0 };
}

const value = (series, { i, f }) => (f ? series[i] + f * (series[i + 1] - series[i]) : series[i]);

/** Shoulder, joints and tip [m], for joint angles [rad]. */
function joints(angles) {
  const points = [[0, 0]];
  let [theta, x, y] = [0, 0, 0];
  angles.forEach((angle, k) => {
    theta += angle;
    x += lengths[k] * Math.sin(theta);
    y -= lengths[k] * Math.cos(theta);
    points.push([x, y]);
  });
  return points;
}

/** Points (x, y, z) from their coordinates over time, one series after the other. */
function pointsOf(series, at) {
  const points = [];
  for (let k = 0; k < series.length; k += 3) points.push([0, 1, 2].map((c) => value(series[k + c], at)));
  return points;
}

const inSpace = target.length === 3;
/** Where the joints, the hand, the nodes and the tip are, and where the arm's joints are to be. */
const posture = (at) => (inSpace ? pointsOf(strike.points, at) : joints(q.map((angles) => value(angles, at))));
const desiredArm = (at) => (inSpace ? pointsOf(strike.desired, at) : joints(q_d.map((angles) => value(angles, at))));
const tipAt = (at) => tip.map((series) => value(series, at));

const hitTime = strike.hit_time ?? Infinity; // of the closest approach, if it is as the target asks
const fixed = (x, digits) => {
  if (!Number.isFinite(x)) return "\u2013";
  return x.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "\u2212");
};
const length = (x) => `${fixed(x, Math.abs(x) < 0.0995 ? 4 : 3)} m`;

const exponential = (x, digits) => x.toExponential(digits).replaceAll("-", "\u2212").replace("e+", "e");

/** A number of any size in about three digits. */
function short(x) {
  const size = Math.abs(x);
  if (size && (size < 1e-3 || size >= 1e4)) return exponential(x, 1);
  return fixed(x, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}
