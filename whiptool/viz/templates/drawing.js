// Lines, discs, words and ticks, in the colours of the page's style.

let colors = {};
function readColors() {
  const style = getComputedStyle(root);
  for (const name of ["blue", "vermilion", "green", "pink", "orange", "sky", "brown", "black", "ink", "faint", "line", "panel",
    "paper", "whip", "slow"]) colors[name] = style.getPropertyValue(`--${name}`).trim();
}

/** A canvas as sharp as the screen; its context takes CSS pixels. */
function surface(canvas, width, height) {
  const sharp = window.devicePixelRatio || 1;
  canvas.width = Math.max(Math.round(width * sharp), 1);
  canvas.height = Math.max(Math.round(height * sharp), 1);
  const context = canvas.getContext("2d");
  context.setTransform(canvas.width / width, 0, 0, canvas.height / height, 0, 0);
  Object.assign(context, { lineCap: "round", lineJoin: "round", font: "11.5px system-ui, sans-serif" });
  return context;
}

function stroke(context, points, style) {
  Object.assign(context, { lineWidth: 1, globalAlpha: 1, ...style });
  context.setLineDash(style.dash ?? []);
  context.lineDashOffset = style.shift ?? 0;
  context.beginPath();
  points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

function disc(context, [x, y], size, fill, edge) {
  context.beginPath();
  context.arc(x, y, size, 0, 2 * Math.PI);
  if (fill) { context.fillStyle = fill; context.fill(); }
  if (edge) { context.strokeStyle = edge; context.stroke(); }
}

/** A word that no line crosses. */
function write(context, text, x, y, behind) {
  Object.assign(context, { strokeStyle: behind, lineWidth: 4, fillStyle: colors.faint });
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

/** A round distance between grid lines, about as long as asked for. */
function roundStep(about) {
  const power = 10 ** Math.floor(Math.log10(about));
  return power * [1, 2, 5, 10].find((x) => x * power >= about * 0.75);
}

/** The multiples of a step within a range. */
function multiples(low, high, step) {
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

const tickText = (x, step) => fixed(x, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
