// From where a strike in space is seen; lengths read true, as from far away.

const orbit = {
  around: 0.6, // [rad] from the right side to the front
  above: 0.35, // [rad]

  /** Where a point is seen: to the right and up [m]. */
  seen([x, y, z]) {
    const [c, s] = [Math.cos(this.around), Math.sin(this.around)];
    const [level, steep] = [Math.cos(this.above), Math.sin(this.above)];
    return [x * c + y * s, z * level + (y * c - x * s) * steep];
  },

  turn(around, above) {
    this.around = around;
    this.above = Math.min(Math.max(above, -Math.PI / 2), Math.PI / 2);
    stage.look();
    draw();
  },
};

if (inSpace) {
  const canvas = byId("stage"), views = { side: [0, 0], front: [Math.PI / 2, 0], top: [0, Math.PI / 2], turned: [0.6, 0.35] };
  canvas.style.touchAction = "none";
  canvas.style.cursor = "grab";
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons !== 1) return;
    byId("view").value = "turned";
    orbit.turn(orbit.around - 0.008 * event.movementX, orbit.above + 0.008 * event.movementY);
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  byId("view").addEventListener("change", (event) => orbit.turn(...views[event.target.value]));
}
