// The stage without WebGL: the same bodies seen by the same camera, as lines and outlines on a 2-D canvas.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});
  const ROUND = 24;

  T.Flat = class {
    constructor(canvas, play, view) {
      this.play = play;
      this.view = view;
      this.pen = canvas.getContext("2d");
      this.lines = view.ground();
      this.local = play.shapes.map(T.local);
      this.calls = 0;
    }

    theme(colours) { this.colours = colours; }

    resize(width, height, ratio) { T.sized(this.pen, width, height, ratio); }

    calm() {}

    draw({ motions, shown, solid, trails }) {
      const { pen, view } = this;
      this.calls = 0;
      pen.clearRect(0, 0, view.width, view.height);
      view.camera.updateMatrixWorld();
      pen.lineCap = "round";
      for (const [a, b] of this.lines) this.line(view.place(a), view.place(b), this.colours.rule, 1, 1);
      for (const p of this.play.ground) this.dot(view.place(p), 4, this.colours.muted, 1);
      trails.forEach((t, p) => t && this.path(t, p < this.play.players.length ? this.play.players[p].colour : this.colours.ink));
      for (const p of T.order(shown, solid)) this.player(motions[p], this.play.players[p].colour, p === solid);
    }

    player(motion, colour, solid) {
      const alpha = solid ? 1 : 0.35;
      this.play.shapes.forEach((s, k) => {
        const place = (at) => this.view.place(motion.point(s.body, at)), pixel = this.pixels(motion.point(s.body, s.a));
        if (s.kind === "ball") this.dot(place(s.a), Math.max(s.radius * pixel, 1.2), colour, alpha);
        else if (s.kind === "rod") this.line(place(s.a), place(s.b), colour, Math.max(2 * s.radius * pixel, solid ? 2 : 1.2), alpha);
        else this.rim(place, s, this.local[k], colour, alpha);
      });
    }

    // a disc is its upper rim, a cone its rim and lines to its tip
    rim(place, s, l, colour, alpha) {
      const { pen } = this, end = s.kind === "cone" ? -0.5 : 0.5, tip = place(s.a);
      pen.beginPath();
      for (let k = 0; k <= ROUND; k++) {
        const c = Math.cos((2 * Math.PI * k) / ROUND), d = Math.sin((2 * Math.PI * k) / ROUND);
        const p = place([0, 1, 2].map((i) => l[i] * c + l[6 + i] * d + l[3 + i] * end + l[9 + i]));
        if (!p) return;
        pen.lineTo(...p);
        if (s.kind === "cone" && tip && k % 4 === 0) { pen.lineTo(...tip); pen.lineTo(...p); }
      }
      Object.assign(pen, { strokeStyle: colour, fillStyle: colour, lineWidth: 1.5, globalAlpha: 0.25 * alpha });
      pen.fill();
      pen.globalAlpha = alpha;
      pen.stroke();
      this.calls++;
    }

    // pixels a metre at a place
    pixels(p) {
      const d = Math.hypot(...this.view.camera.position.toArray().map((x, c) => x - p[c]));
      return (0.5 * this.view.height) / (Math.tan((this.view.camera.fov * Math.PI) / 360) * d);
    }

    line(a, b, colour, width, alpha) {
      if (!a || !b) return;
      Object.assign(this.pen, { globalAlpha: alpha, strokeStyle: colour, lineWidth: width });
      T.stroke(this.pen, [a, b]);
      this.calls++;
    }

    dot(p, radius, colour, alpha) {
      if (!p) return;
      const { pen } = this;
      Object.assign(pen, { globalAlpha: alpha, fillStyle: colour });
      pen.beginPath();
      pen.arc(...p, radius, 0, 2 * Math.PI);
      pen.fill();
      this.calls++;
    }

    path({ path, from, to, head }, colour) {
      const points = [];
      for (let k = from; k <= to + 1; k++) points.push(this.view.place(k > to ? head : path.subarray(3 * k, 3 * k + 3)));
      Object.assign(this.pen, { globalAlpha: 0.8, strokeStyle: colour, lineWidth: 1.2 });
      T.stroke(this.pen, points);
      this.calls++;
    }

    facts() { return { renderer: "2-D canvas", calls: this.calls, triangles: 0, lines: 0 }; }
  };
})();
