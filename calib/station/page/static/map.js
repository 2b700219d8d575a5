// The map: an orthographic look at the ENU frame, from straight above or tilted. One projection serves both, so that
// the scale bar holds and nothing is drawn twice.
const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
const LEVELS = { ok: "#1a7f37", warn: "#b07400", fail: "#c0202b" };
const EARTH_M = 40075016.68557849; // around the equator, as Web Mercator has it
const KEPT = "skyfix-view"; // where the browser keeps how one looked
const RAY_M = 2000; // a ray is drawn so far
const FIELD_SHARE = 0.35; // of the shown width: how far a field of view is drawn

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class MapView {
  constructor(canvas, buttons) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.look = { at: [0, 0, 0], scale: 2, yaw: 0, tilt: 90, rays: true, coverage: false, chosen: false };
    try { Object.assign(this.look, JSON.parse(localStorage.getItem(KEPT) ?? "{}")); } catch { /* a new look, then */ }
    this.tiles = new Map();
    this.buttons = [...buttons];
    for (const button of this.buttons) button.addEventListener("click", () => this.act(button.dataset.do));
    this.listen();
    this.press();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  show(scene, frame) {
    this.scene = scene ?? this.scene;
    this.frame = frame;
    if (!this.look.chosen && this.scene?.cameras.some((c) => c.at)) this.showAll();
    for (const target of frame.targets) {
      const trail = (this.scene ? (this.scene.trails[target.id] ??= []) : []);
      const last = trail.at(-1);
      if (!last || Math.hypot(...last.map((v, i) => v - target.at[i])) > 0.3) trail.push(target.at);
      if (trail.length > 300) trail.shift();
    }
    this.draw();
  }

  // Looking

  act(what) {
    if (what === "3d") this.look.tilt = this.look.tilt === 90 ? 30 : 90;
    if (what === "3d" && this.look.tilt === 90) this.look.yaw = 0;
    if (what === "in") this.zoom(1.25);
    if (what === "out") this.zoom(0.8);
    if (what === "all") this.showAll();
    if (what === "rays") this.look.rays = !this.look.rays;
    if (what === "coverage") this.look.coverage = !this.look.coverage;
    this.keep();
  }

  keep() {
    this.look.chosen = true;
    try { localStorage.setItem(KEPT, JSON.stringify(this.look)); } catch { /* a private window keeps nothing */ }
    this.press();
    this.draw();
  }

  press() {
    const on = { "3d": this.look.tilt !== 90, rays: this.look.rays, coverage: this.look.coverage };
    for (const button of this.buttons) {
      if (button.dataset.do in on) button.setAttribute("aria-pressed", String(on[button.dataset.do]));
    }
  }

  showAll() {
    const points = [...(this.scene?.cameras ?? []).filter((c) => c.at).map((c) => c.at),
      ...(this.frame?.targets ?? []).map((t) => t.at)];
    if (!points.length) return;
    const low = [0, 1].map((i) => Math.min(...points.map((p) => p[i])));
    const high = [0, 1].map((i) => Math.max(...points.map((p) => p[i])));
    const [width, height] = [this.canvas.clientWidth || 300, this.canvas.clientHeight || 300];
    this.look.at = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0];
    this.look.scale = 0.6 * Math.min(width / Math.max(high[0] - low[0], 20), height / Math.max(high[1] - low[1], 20));
  }

  zoom(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    const before = this.ground(x, y);
    this.look.scale = Math.min(500, Math.max(0.005, this.look.scale * factor));
    const after = this.ground(x, y);
    this.look.at[0] += before[0] - after[0];
    this.look.at[1] += before[1] - after[1];
  }

  move(right, down) {
    const from = this.ground(0, 0), to = this.ground(right, down);
    this.look.at[0] -= to[0] - from[0];
    this.look.at[1] -= to[1] - from[1];
  }

  turn(right, down) {
    this.look.yaw += right * 0.4;
    this.look.tilt = Math.min(89, Math.max(5, this.look.tilt + down * 0.3));
  }

  listen() {
    const pointers = new Map();
    this.canvas.addEventListener("pointerdown", (e) => {
      pointers.set(e.pointerId, [e.offsetX, e.offsetY]);
      this.canvas.setPointerCapture(e.pointerId);
    });
    this.canvas.addEventListener("pointermove", (e) => {
      const last = pointers.get(e.pointerId);
      if (!last) return;
      const [dx, dy] = [e.offsetX - last[0], e.offsetY - last[1]];
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== e.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        this.zoom(apart([e.offsetX, e.offsetY]) / Math.max(apart(last), 1), other[0], other[1]);
      } else if (this.look.tilt !== 90 && !e.shiftKey) this.turn(dx, dy);
      else this.move(dx, dy);
      pointers.set(e.pointerId, [e.offsetX, e.offsetY]);
      this.keep();
    });
    for (const end of ["pointerup", "pointercancel"]) this.canvas.addEventListener(end, (e) => pointers.delete(e.pointerId));
    this.canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom(Math.exp(-e.deltaY * 0.0015), e.offsetX, e.offsetY);
      this.keep();
    }, { passive: false });
    this.canvas.addEventListener("keydown", (e) => this.key(e));
  }

  key(event) {
    const moves = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] };
    const acts = { "+": "in", "=": "in", "-": "out", 0: "all", 3: "3d", r: "rays", c: "coverage" };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key in moves) {
      if (event.shiftKey && this.look.tilt !== 90) this.turn(...moves[event.key].map((v) => -v / 4));
      else this.move(...moves[event.key]);
      this.keep();
    } else if (event.key in acts) this.act(acts[event.key]);
    else return;
    event.preventDefault();
  }

  // Projecting

  axes() {
    const yaw = this.look.yaw * Math.PI / 180, tilt = this.look.tilt * Math.PI / 180;
    const s = this.look.tilt === 90 ? 1 : Math.sin(tilt), c = this.look.tilt === 90 ? 0 : Math.cos(tilt);
    return [[Math.cos(yaw), Math.sin(yaw), 0], [Math.sin(yaw) * s, -Math.cos(yaw) * s, -c]];
  }

  place(p) {
    const d = p.map((v, i) => v - this.look.at[i]);
    const [right, down] = this.axes().map((a) => a[0] * d[0] + a[1] * d[1] + a[2] * d[2]);
    return [this.canvas.clientWidth / 2 + right * this.look.scale, this.canvas.clientHeight / 2 + down * this.look.scale];
  }

  ground(x, y) {
    const r = (x - this.canvas.clientWidth / 2) / this.look.scale;
    const tilt = this.look.tilt === 90 ? 1 : Math.sin(this.look.tilt * Math.PI / 180);
    const d = (y - this.canvas.clientHeight / 2) / this.look.scale / tilt;
    const yaw = this.look.yaw * Math.PI / 180;
    return [this.look.at[0] + r * Math.cos(yaw) + d * Math.sin(yaw), this.look.at[1] + r * Math.sin(yaw) - d * Math.cos(yaw)];
  }

  // Drawing

  draw() {
    const { canvas, pen } = this, ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !this.scene) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = `${width > 2200 ? 20 : 13}px system-ui, sans-serif`;
    if (this.look.tilt === 90 && this.scene.origin) this.drawTiles(width, height);
    if (this.look.coverage) this.drawCoverage();
    this.drawGrid(width, height);
    this.drawCameras(width);
    if (this.look.rays) this.drawRays();
    this.drawTargets();
    this.drawScale(height);
  }

  line(points, colour, thickness = 1, alpha = 1) {
    const { pen } = this;
    pen.beginPath();
    points.forEach((p, i) => (i ? pen.lineTo(...this.place(p)) : pen.moveTo(...this.place(p))));
    pen.strokeStyle = colour;
    pen.globalAlpha = alpha;
    pen.lineWidth = thickness;
    pen.stroke();
    pen.globalAlpha = 1;
  }

  step(width) {
    const wanted = 90 / this.look.scale, power = 10 ** Math.floor(Math.log10(wanted));
    return [1, 2, 5, 10].map((k) => k * power).find((s) => s >= wanted) ?? 10 * power;
  }

  drawGrid(width, height) {
    const step = this.step(width), colour = css("--line");
    const edge = [[0, 0], [width, 0], [width, height], [0, height]].map(([x, y]) => this.ground(x, y));
    const range = [0, 1].map((i) => [Math.min(...edge.map((p) => p[i])), Math.max(...edge.map((p) => p[i]))]);
    for (const axis of [0, 1]) {
      const [low, high] = range[axis], other = range[1 - axis];
      if ((high - low) / step > 200) continue; // nearly level: lines without end
      for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
        const ends = other.map((o) => (axis === 0 ? [v, o, 0] : [o, v, 0]));
        this.line(ends, colour, Math.abs(v) < step / 2 ? 2 : 1);
      }
    }
  }

  drawScale(height) {
    const { pen } = this, step = this.step(), length = step * this.look.scale, y = height - 16;
    pen.fillStyle = pen.strokeStyle = css("--ink");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(14, y - 5); pen.lineTo(14, y); pen.lineTo(14 + length, y); pen.lineTo(14 + length, y - 5);
    pen.stroke();
    pen.textAlign = "left";
    pen.fillText(step >= 1000 ? `${step / 1000} km` : `${step} m`, 20, y - 6);
    const north = this.place([this.look.at[0], this.look.at[1] + 1, this.look.at[2]]);
    const centre = this.place(this.look.at);
    const angle = Math.atan2(north[0] - centre[0], centre[1] - north[1]);
    pen.save();
    pen.translate(28, 34);
    pen.rotate(angle);
    pen.beginPath();
    pen.moveTo(0, -16); pen.lineTo(6, 8); pen.lineTo(0, 4); pen.lineTo(-6, 8); pen.closePath();
    pen.fill();
    pen.textAlign = "center";
    pen.fillText("N", 0, -19);
    pen.restore();
  }

  drawCoverage() {
    const { pen } = this, cell = this.scene.cell_m;
    pen.fillStyle = "#009E73";
    for (const [east, north, count] of this.scene.coverage) {
      pen.globalAlpha = Math.min(0.5, 0.08 + 0.05 * Math.log2(1 + count));
      pen.beginPath();
      [[0, 0], [1, 0], [1, 1], [0, 1]].forEach(([i, j], k) => {
        const spot = this.place([(east + i) * cell, (north + j) * cell, 0]);
        if (k) pen.lineTo(...spot); else pen.moveTo(...spot);
      });
      pen.fill();
    }
    pen.globalAlpha = 1;
  }

  drawCameras(width) {
    const { pen } = this, far = FIELD_SHARE * width / this.look.scale;
    this.scene.cameras.forEach((camera, index) => {
      if (!camera.at) return;
      const colour = COLOURS[index % COLOURS.length];
      const ends = (camera.corners ?? []).map((d) => camera.at.map((v, i) => v + far * d[i]));
      pen.globalAlpha = 0.07;
      pen.fillStyle = colour;
      ends.forEach((end, i) => { // each side of the pyramid; from above they lie over each other
        pen.beginPath();
        pen.moveTo(...this.place(camera.at)); pen.lineTo(...this.place(end)); pen.lineTo(...this.place(ends[(i + 1) % ends.length]));
        pen.fill();
      });
      pen.globalAlpha = 1;
      for (const end of ends) this.line([camera.at, end], colour, 1, 0.35);
      const [x, y] = this.place(camera.at);
      pen.fillStyle = LEVELS[camera.level];
      pen.beginPath();
      pen.arc(x, y, 7, 0, 2 * Math.PI);
      pen.fill();
      pen.strokeStyle = colour;
      pen.lineWidth = 3;
      pen.stroke();
      pen.fillStyle = css("--ink");
      pen.textAlign = "left";
      pen.fillText(camera.level === "ok" ? camera.id : `${camera.id}: ${camera.reason}`.slice(0, 40), x + 12, y + 4);
    });
  }

  drawRays() {
    for (const row of this.frame.rays) {
      const index = this.scene.cameras.findIndex((c) => c.id === row.camera);
      for (const d of row.to) {
        const end = row.from.map((v, i) => v + RAY_M * d[i]);
        this.line([row.from, end], COLOURS[Math.max(index, 0) % COLOURS.length], 1, 0.6);
      }
    }
  }

  drawTargets() {
    const { pen } = this, ink = css("--ink");
    for (const trail of Object.values(this.scene.trails)) if (trail.length > 1) this.line(trail, ink, 1.5, 0.5);
    for (const target of this.frame.targets) {
      const colour = target.state === "confirmed" ? LEVELS.fail : LEVELS.warn;
      this.drawEllipse(target, colour);
      if (this.look.tilt !== 90) this.line([target.at, [target.at[0], target.at[1], 0]], ink, 1, 0.4);
      this.line([target.at, target.at.map((v, i) => v + target.velocity[i])], colour, 2);
      const [x, y] = this.place(target.at);
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(x, y, 5, 0, 2 * Math.PI);
      pen.fill();
      pen.fillStyle = ink;
      pen.textAlign = "left";
      const speed = Math.hypot(...target.velocity).toFixed(0);
      const state = target.state === "confirmed" ? "" : ` ${target.state}`;
      pen.fillText(`${target.id}${state}: ${target.at[2].toFixed(0)} m up, ${speed} m/s`, x + 10, y - 8);
    }
  }

  drawEllipse(target, colour) {
    const [a, b, c, d, e, f] = target.spread, full = [[a, b, c], [b, d, e], [c, e, f]], axes = this.axes();
    const on = (u, v) => u.reduce((sum, ui, i) => sum + ui * v.reduce((s, vj, j) => s + full[i][j] * vj, 0), 0);
    const [xx, xy, yy] = [on(axes[0], axes[0]), on(axes[0], axes[1]), on(axes[1], axes[1])];
    const middle = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy);
    const [x, y] = this.place(target.at), { pen } = this;
    pen.beginPath();
    pen.ellipse(x, y, Math.sqrt(Math.max(middle + off, 0)) * this.look.scale,
      Math.sqrt(Math.max(middle - off, 0)) * this.look.scale, 0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
    pen.strokeStyle = colour;
    pen.lineWidth = 1.5;
    pen.stroke();
    pen.globalAlpha = 0.15;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }

  // Tiles that the operator has put there; good to a metre within some kilometres of the origin

  drawTiles(width, height) {
    if (this.noTiles) return;
    const [latitude, longitude] = this.scene.origin, shrink = Math.cos(latitude * Math.PI / 180);
    const zoom = Math.min(19, Math.max(0, Math.round(Math.log2(this.look.scale * EARTH_M * shrink / 256))));
    const count = 2 ** zoom, size = EARTH_M * shrink / count; // metres on the ground
    const x0 = (longitude + 180) / 360 * count;
    const y0 = (1 - Math.asinh(Math.tan(latitude * Math.PI / 180)) / Math.PI) / 2 * count;
    const [west, north] = this.ground(0, 0), [east, south] = this.ground(width, height);
    for (let x = Math.floor(x0 + west / size); x <= x0 + east / size; x++) {
      for (let y = Math.floor(y0 - north / size); y <= y0 - south / size; y++) {
        const image = this.tile(`${zoom}/${x}/${y}`);
        if (!image) continue;
        const [left, top] = this.place([(x - x0) * size, (y0 - y) * size, this.look.at[2]]);
        this.pen.globalAlpha = 0.7;
        this.pen.drawImage(image, left, top, size * this.look.scale + 0.5, size * this.look.scale + 0.5);
        this.pen.globalAlpha = 1;
      }
    }
  }

  tile(name) {
    if (!document.querySelector("main[data-tiles]")) {
      this.noTiles = true;
      return null;
    }
    let image = this.tiles.get(name);
    if (!image) {
      image = new Image();
      image.src = `/tiles/${name}.png`;
      image.onload = () => this.draw();
      this.tiles.set(name, image);
      if (this.tiles.size > 300) this.tiles.delete(this.tiles.keys().next().value);
    }
    return image.complete && image.naturalWidth ? image : null;
  }
}
