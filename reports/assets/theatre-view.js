// The camera of the theatre, the same for WebGL and for the flat drawing and in every cell: orbit, fit, named views.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});
  const V = THREE.Vector3;
  const FIELD = 32; // [deg]

  // 2-D canvases: their size, a line through points [x, y] (null: left out), and who is drawn, the solid one last
  T.sized = (pen, width, height, ratio) => {
    Object.assign(pen.canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  };
  T.stroke = (pen, points) => {
    pen.beginPath();
    for (const p of points) if (p) pen.lineTo(...p);
    pen.stroke();
  };
  T.order = (shown, solid) => [...shown.keys()].filter((p) => shown[p] && p !== solid).concat(shown[solid] ? [solid] : []);

  T.View = class {
    constructor(canvas, play, moved) {
      this.low = new V(...play.low);
      this.high = new V(...play.high);
      this.centre = this.low.clone().add(this.high).multiplyScalar(0.5);
      this.size = Math.max(this.low.distanceTo(this.high), 1e-9);
      const g = new V(...play.gravity);
      this.heavy = g.length() > 0;
      this.up = this.heavy ? g.clone().normalize().negate() : new V(0, 0, 1);
      this.normal = play.normal ? new V(...play.normal) : null;
      this.camera = new THREE.PerspectiveCamera(FIELD, 1, this.size / 200, this.size * 40);
      this.camera.up.copy(this.up);
      this.controls = new THREE.OrbitControls(this.camera, canvas);
      this.controls.minDistance = this.size / 40;
      this.controls.maxDistance = this.size * 12;
      this.controls.addEventListener("change", moved);
      this.controls.addEventListener("start", () => { this.name = ""; this.held = true; });
      this.controls.addEventListener("end", () => { this.held = false; moved(); });
      this.name = "start";
    }

    // horizontal direction to look from: along the normal of a plane of motion, else at the broader side
    front() {
      let n = this.normal && this.normal.clone().addScaledVector(this.up, -this.normal.dot(this.up));
      if (!n || n.length() < 0.3) {
        const sides = [new V(0, 0, 1), new V(1, 0, 0), new V(0, 1, 0)].filter((a) => Math.abs(a.dot(this.up)) < 0.8);
        const d = this.high.clone().sub(this.low);
        const thin = (a) => Math.abs(a.x * d.x) + Math.abs(a.y * d.y) + Math.abs(a.z * d.z);
        n = sides.reduce((a, b) => (thin(b) < thin(a) * 0.99 ? b : a)).clone();
        n.addScaledVector(this.up, -n.dot(this.up));
      }
      return n.normalize();
    }

    direction(name) {
      const front = this.front(), side = this.up.clone().cross(front);
      const mix = (azimuth, height) => front.clone().multiplyScalar(Math.cos(azimuth) * Math.cos(height))
        .addScaledVector(side, Math.sin(azimuth) * Math.cos(height)).addScaledVector(this.up, Math.sin(height));
      return { front: () => mix(0, 0), side: () => mix(Math.PI / 2, 0), above: () => mix(0, 1.5),
        oblique: () => mix(0.62, 0.42), start: () => (this.normal ? mix(0.22, 0.13) : mix(0.5, 0.28)) }[name]();
    }

    // look from there, everything just inside
    show(name) {
      const d = this.direction(name), right = this.up.clone().cross(d).normalize(), top = d.clone().cross(right);
      const tall = Math.tan((FIELD / 2) * Math.PI / 180) * 0.92, wide = tall * this.camera.aspect;
      let distance = 0;
      for (let k = 0; k < 8; k++) {
        const p = new V(k & 1 ? this.high.x : this.low.x, k & 2 ? this.high.y : this.low.y, k & 4 ? this.high.z : this.low.z).sub(this.centre);
        distance = Math.max(distance, p.dot(d) + Math.max(Math.abs(p.dot(right)) / wide, Math.abs(p.dot(top)) / tall));
      }
      this.controls.target.copy(this.centre);
      this.camera.position.copy(this.centre).addScaledVector(d, Math.max(distance, 1e-6));
      this.controls.update();
      this.name = name;
    }

    // `count` equal cells on a canvas, each below a line for its label: as many beside each other as show most
    cells(count, width, height, label) {
      const front = this.front(), side = this.up.clone().cross(front), wide = this.reach(side), tall = this.reach(this.up);
      const size = (n) => [width / n, height / Math.ceil(count / n) - label];
      const scale = (n) => Math.min(size(n)[0] / wide, size(n)[1] / tall);
      let best = 1;
      for (let n = 2; n <= count; n++) if (scale(n) > scale(best) * 1.001) best = n;
      const [w, h] = size(best).map(Math.floor);
      this.resize(w, Math.max(h, 1));
      return Array.from({ length: count }, (_, k) => ({ x: (k % best) * w, y: Math.floor(k / best) * (h + label) + label, w, h }));
    }

    resize(width, height) {
      this.width = width;
      this.height = height;
      this.camera.aspect = Math.max(width, 1) / Math.max(height, 1); // no size for a moment: while a phone turns
      this.camera.updateProjectionMatrix();
      if (this.name) this.show(this.name);
    }

    // half the extent of the motion along a direction
    reach(d) {
      const size = this.high.clone().sub(this.low);
      return 0.5 * (Math.abs(d.x * size.x) + Math.abs(d.y * size.y) + Math.abs(d.z * size.z)) || 1e-9;
    }

    // to be called before a frame's first place()
    aim() {
      this.camera.updateMatrixWorld();
      (this.matrix ||= this.camera.projectionMatrix.clone()).multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    }

    // pixels a metre at the point looked at
    get pixels() { return 0.5 * this.height / (Math.tan((FIELD * Math.PI) / 360) * this.camera.position.distanceTo(this.controls.target)); }

    // radius of a bar that is still seen
    get least() { return 2 / this.pixels; }

    // a place in space in its cell: [x, y] in CSS pixels, null behind the camera
    place(p) {
      const m = this.matrix.elements, w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
      if (w <= 0) return null;
      const x = m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12], y = m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13];
      return [(x / w + 1) * 0.5 * this.width, (1 - y / w) * 0.5 * this.height];
    }

    // the axes of space and gravity as the camera sees them, in a corner
    point(svg) {
      const seen = this.camera.quaternion, v = (this.scratch ||= new V());
      for (const g of svg.querySelectorAll("g")) {
        const a = g.dataset.axis === "g" ? this.up : null, k = "XYZ".indexOf(g.dataset.axis);
        if (a) v.copy(a).negate(); else v.set(k === 0, k === 1, k === 2);
        v.applyQuaternion((this.back ||= seen.clone()).copy(seen).invert());
        const [line, text] = g.children, long = a ? 1.25 : 1;
        line.setAttribute("x2", (26 * long * v.x).toFixed(1));
        line.setAttribute("y2", (-26 * long * v.y).toFixed(1));
        text.setAttribute("x", ((26 * long + 8) * v.x).toFixed(1));
        text.setAttribute("y", (-(26 * long + 8) * v.y + 4).toFixed(1));
        g.style.opacity = v.z < -0.3 ? 0.55 : 1;
        if (a) g.style.display = this.heavy ? "" : "none";
      }
    }

    // lines of the ground: pairs of points
    ground() {
      const lines = [], at = (p) => [p.x, p.y, p.z];
      if (!this.heavy) return lines;
      const front = this.front(), side = this.up.clone().cross(front);
      const foot = this.centre.clone().addScaledVector(this.up, -this.reach(this.up) - 0.015 * this.size);
      const a = this.reach(side) * 1.15, b = Math.max(this.reach(front) * 1.15, 0.28 * a), n = 12, cell = (2 * a) / n, rows = Math.max(2, Math.round((2 * b) / cell));
      const corner = (x, y) => at(foot.clone().addScaledVector(side, x).addScaledVector(front, y));
      for (let k = 0; k <= n; k++) lines.push([corner(-a + k * cell, -0.5 * rows * cell), corner(-a + k * cell, 0.5 * rows * cell)]);
      for (let k = 0; k <= rows; k++) lines.push([corner(-a, (k - 0.5 * rows) * cell), corner(a, (k - 0.5 * rows) * cell)]);
      return lines;
    }
  };
})();
