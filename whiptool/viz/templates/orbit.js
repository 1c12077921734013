// From where a strike in space is seen: in perspective, turned and zoomed, or flat, so that lengths read true.

const DEGREE = Math.PI / 180, DISTANCE = 4, NEAREST = 0.3, FARTHEST = 20; // of the eye, in half sizes; least, most zoom
const VIEWS = { // around from x to the left and above [deg]
  turned: { around: -55, above: 20, flat: false }, side: { around: -90, above: 0, flat: true },
  top: { around: -90, above: 90, flat: true }, front: { around: 0, above: 0, flat: true },
};

const orbit = {
  ...VIEWS.turned,
  name: "turned",
  zoom: 1,
  shift: [0, 0], // of the picture [pixels]

  /** Middle and half size of what is shown [m], which what is seen is scaled to. */
  fit(extent) {
    this.centre = extent.map(([low, high]) => (low + high) / 2);
    this.half = Math.hypot(...extent.map(([low, high]) => (high - low) / 2));
  },

  /** Where a point is seen from the middle: to the right and up [m], and how much larger than in the middle. */
  seen(point) {
    const [x, y, z] = point.map((p, c) => p - this.centre[c]);
    const [c, s] = [Math.cos(DEGREE * this.around), Math.sin(DEGREE * this.around)];
    const [level, steep] = [Math.cos(DEGREE * this.above), Math.sin(DEGREE * this.above)];
    const out = x * c + y * s, far = DISTANCE * this.half; // out: away from the z axis, toward the eye
    const size = this.flat ? 1 : far / (far - (out * level + z * steep));
    return [size * (y * c - x * s), size * (z * level - out * steep), size];
  },

  /** Look from elsewhere: change any of around, above, flat, name, zoom, shift. */
  look(changes) {
    Object.assign(this, changes);
    this.above = Math.min(Math.max(this.above, -90), 90);
    this.around = ((((this.around + 180) % 360) + 360) % 360) - 180;
    this.zoom = Math.min(Math.max(this.zoom, NEAREST), FARTHEST);
    byId("view").value = this.name;
    stage.look();
    draw();
  },

  turn(around, above) {
    this.look({ around: this.around + around, above: this.above + above, flat: false, name: "turned" });
  },

  show(name) {
    this.look({ ...VIEWS[name], name, zoom: 1, shift: [0, 0] });
  },

  /** Zoom about a place of the picture [pixels from its middle], which stays where it is. */
  zoomBy(factor, at = [0, 0]) {
    const zoom = Math.min(Math.max(this.zoom * factor, NEAREST), FARTHEST), real = zoom / this.zoom;
    this.look({ zoom, shift: this.shift.map((s, k) => at[k] - real * (at[k] - s)) });
  },

  /** What the address says of the view. */
  address() {
    if (!inSpace) return "";
    if (this.name !== "turned") return `&view=${this.name}`;
    return `&view=${[this.around, this.above, this.zoom].map((x) => Number(x.toFixed(2))).join(",")}`;
  },

  fromAddress(given) {
    if (!inSpace || !given) return;
    if (given in VIEWS) { this.show(given); return; }
    const [around, above, zoom] = given.split(",").map(Number);
    if ([around, above].every(Number.isFinite)) {
      this.look({ ...VIEWS.turned, around, above, name: "turned", zoom: zoom > 0 ? zoom : 1, shift: [0, 0] });
    }
  },
};

const STEP = 5; // [deg], of a key
orbit.keys = inSpace ? {
  a: () => orbit.turn(-STEP, 0), d: () => orbit.turn(STEP, 0), w: () => orbit.turn(0, STEP),
  s: () => orbit.turn(0, -STEP), "+": () => orbit.zoomBy(1.2), "=": () => orbit.zoomBy(1.2),
  "-": () => orbit.zoomBy(1 / 1.2), 0: () => orbit.show("turned"), 1: () => orbit.show("side"),
  2: () => orbit.show("top"), 3: () => orbit.show("front"),
} : {};

if (inSpace) {
  const canvas = byId("stage"), fingers = new Map(); // fingers and mouse buttons that are down, by number
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.style.touchAction = "none";
  canvas.style.cursor = "grab";
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    try { canvas.setPointerCapture(event.pointerId); } catch { /* a pointer that is gone, or made by a program */ }
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const apart = fingers.size > 1 ? spread() : 0;
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (apart) { orbit.zoomBy(spread() / apart); return; }
    orbit.turn(-0.45 * (event.offsetX - before[0]), 0.45 * (event.offsetY - before[1]));
  });
  for (const ended of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(ended, (event) => { fingers.delete(event.pointerId); remember(); });
  }
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    const at = [event.offsetX - stage.middle[0], event.offsetY - stage.middle[1]];
    orbit.zoomBy(Math.exp(-0.0015 * lines * event.deltaY), at);
    remember();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { orbit.show("turned"); remember(); });
  byId("view").addEventListener("change", (event) => { orbit.show(event.target.value); remember(); });
}
