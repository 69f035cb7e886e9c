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

    resize(width, height, ratio) {
      const { canvas } = this.pen;
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      this.ratio = ratio;
    }

    calm() {}

    draw({ motions, shown, solid, trails }) {
      const { pen, view } = this;
      this.calls = 0;
      pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      pen.clearRect(0, 0, view.width, view.height);
      view.camera.updateMatrixWorld();
      pen.lineCap = "round";
      for (const [a, b] of this.lines) this.line(view.place(a), view.place(b), this.colours.rule, 1, 1);
      for (const p of this.play.ground) this.dot(view.place(p), 4, this.colours.muted, 1);
      trails.forEach((t, p) => t && this.path(t, this.play.players[p].colour));
      const order = motions.map((_, p) => p).filter((p) => shown[p] && p !== solid);
      if (shown[solid]) order.push(solid);
      for (const p of order) this.player(motions[p].body, this.play.players[p].colour, p === solid);
    }

    player(body, colour, solid) {
      const alpha = solid ? 1 : 0.35;
      this.play.shapes.forEach((s, k) => {
        const a = this.space(body, s.body, s.a), pixel = this.pixels(a);
        if (s.kind === "ball") this.dot(this.view.place(a), Math.max(s.radius * pixel, 1.2), colour, alpha);
        else if (s.kind === "rod") this.line(this.view.place(a), this.view.place(this.space(body, s.body, s.b)), colour, Math.max(2 * s.radius * pixel, solid ? 2 : 1.2), alpha);
        else this.rim(body, s, this.local[k], colour, alpha);
      });
    }

    // a disc is its upper rim, a cone its rim and lines to its tip
    rim(body, s, l, colour, alpha) {
      const { pen, view } = this, end = s.kind === "cone" ? -0.5 : 0.5, tip = view.place(this.space(body, s.body, s.a));
      pen.beginPath();
      for (let k = 0; k <= ROUND; k++) {
        const c = Math.cos((2 * Math.PI * k) / ROUND), d = Math.sin((2 * Math.PI * k) / ROUND);
        const p = view.place(this.space(body, s.body, [0, 1, 2].map((i) => l[i] * c + l[6 + i] * d + l[3 + i] * end + l[9 + i])));
        if (!p) return;
        if (k) pen.lineTo(...p); else pen.moveTo(...p);
        if (s.kind === "cone" && tip && k % 4 === 0) { pen.lineTo(...tip); pen.lineTo(...p); }
      }
      pen.strokeStyle = pen.fillStyle = colour;
      pen.lineWidth = 1.5;
      pen.globalAlpha = 0.25 * alpha;
      pen.fill();
      pen.globalAlpha = alpha;
      pen.stroke();
      this.calls++;
    }

    space(R, b, s) {
      const o = 12 * b;
      return [0, 1, 2].map((c) => R[o + c] * s[0] + R[o + 3 + c] * s[1] + R[o + 6 + c] * s[2] + R[o + 9 + c]);
    }

    // pixels a metre at a place
    pixels(p) {
      const d = Math.hypot(...this.view.camera.position.toArray().map((x, c) => x - p[c]));
      return (0.5 * this.view.height) / (Math.tan((this.view.camera.fov * Math.PI) / 360) * d);
    }

    line(a, b, colour, width, alpha) {
      if (!a || !b) return;
      const { pen } = this;
      pen.globalAlpha = alpha;
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.beginPath();
      pen.moveTo(...a);
      pen.lineTo(...b);
      pen.stroke();
      this.calls++;
    }

    dot(p, radius, colour, alpha) {
      if (!p) return;
      const { pen } = this;
      pen.globalAlpha = alpha;
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(...p, radius, 0, 2 * Math.PI);
      pen.fill();
      this.calls++;
    }

    path({ path, from, to, head }, colour) {
      const { pen, view } = this;
      pen.globalAlpha = 0.8;
      pen.strokeStyle = colour;
      pen.lineWidth = 1.2;
      pen.beginPath();
      for (let k = from; k <= to + 1; k++) {
        const p = view.place(k > to ? head : path.subarray(3 * k, 3 * k + 3));
        if (p) { if (k === from) pen.moveTo(...p); else pen.lineTo(...p); }
      }
      pen.stroke();
      this.calls++;
    }

    facts() { return { renderer: "2-D canvas", calls: this.calls, triangles: 0, lines: 0 }; }
  };
})();
