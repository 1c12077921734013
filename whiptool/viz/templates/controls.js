// Readings, controls, keys, and the address; here everything begins.

const tipName = inSpace ? "Tip at (x, y, z)" : "Tip at (x, y)";
const readings = Object.fromEntries(["Tip speed", "Distance", "Target", tipName].map((name) => {
  const group = byId("readings").appendChild(document.createElement("div"));
  group.append(Object.assign(document.createElement("dt"), { textContent: name }));
  return [name, group.appendChild(document.createElement("dd"))];
}));

function draw() {
  state.at = locate(state.t);
  stage.draw();
  plots.forEach((plot) => plot.draw());
  const here = (series) => value(series, state.at);
  const [speed, away] = [`${fixed(here(strike.speed), 1)} m/s`, length(here(strike.distance))];
  readings["Tip speed"].textContent = speed;
  readings.Distance.textContent = away;
  readings[tipName].textContent = `(${tipAt(state.at).map((x) => fixed(x, 3)).join(", ")}) m`;
  readings.Target.textContent = state.t >= hitTime ? "hit" : "not hit so far";
  byId("now").textContent = `${fixed(state.t, 4)} s`;
  byId("time").value = state.t;
  byId("time").setAttribute("aria-valuetext", `${fixed(state.t, 3)} s, tip at ${speed}, ${away} from the target`);
  root.dataset.drawn = fixed(state.t, 4);
}

function seek(time) {
  state.t = Math.min(Math.max(time, start), end);
  draw();
}

/** Keep the instant in the address, so that it can be passed on. */
function remember() {
  try {
    history.replaceState(null, "", `#t=${state.t.toFixed(4)}${orbit.address()}`);
  } catch { /* where the page is embedded, its address is not its own */ }
}

function pause() {
  state.playing = false;
  byId("play").textContent = "Play";
}

function play() {
  state.playing = true;
  byId("play").textContent = "Pause";
  let before = null;
  const frame = (now) => {
    if (!state.playing) return;
    const passed = before === null ? 0 : Math.min((now - before) / 1e3, 0.1);
    before = now;
    const next = state.t + passed * Number(byId("speed").value);
    seek(next > end || state.t >= end ? start : next);
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

function toggle() {
  if (state.playing) { pause(); remember(); } else play();
}

/** Go to the k-th sample from here. */
function step(k) {
  pause();
  const { i, f } = state.at, here = k > 0 ? i + Math.floor(f + 1e-9) : i + Math.ceil(f - 1e-9);
  seek(t[Math.min(Math.max(here + k, 0), t.length - 1)]);
  remember();
}

function jump(time) {
  pause();
  seek(time);
  remember();
}

function fromAddress() {
  const address = new URLSearchParams(location.hash.slice(1)), given = Number.parseFloat(address.get("t"));
  orbit.fromAddress(address.get("view"));
  if (Number.isFinite(given)) { pause(); seek(given); }
}

const slider = byId("time");
Object.assign(slider, { min: start, max: end, step: "any" });
slider.addEventListener("input", () => { pause(); seek(Number(slider.value)); });
slider.addEventListener("change", remember);
byId("play").addEventListener("click", toggle);
byId("back").addEventListener("click", () => step(-1));
byId("forth").addEventListener("click", () => step(1));
byId("nearest").addEventListener("click", () => jump(near.time));
byId("nearest").disabled = !near;

addEventListener("keydown", (event) => {
  const { key, target: on } = event;
  if (event.ctrlKey || event.metaKey || event.altKey || on instanceof HTMLSelectElement) return;
  if (key === " " && on instanceof HTMLButtonElement) return; // it presses the button
  const many = event.shiftKey ? 10 : 1;
  const action = {
    " ": toggle, ArrowLeft: () => step(-many), ArrowRight: () => step(many), Home: () => jump(start),
    End: () => jump(end), c: () => near && jump(near.time), ...orbit.keys,
  }[key];
  if (!action) return;
  event.preventDefault();
  action();
});
addEventListener("hashchange", fromAddress);

function layOut() {
  readColors();
  stage.resize();
  plots.forEach((plot) => plot.resize());
  draw();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", layOut);
layOut();
fromAddress();
new ResizeObserver(layOut).observe(document.querySelector("main"));
