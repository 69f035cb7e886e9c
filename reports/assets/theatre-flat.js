// The stage without WebGL, or where it is drawn by the processor: the same bodies seen by the same camera, as lines.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});
  const ROUND = 24;

  T.Flat = class {
    constructor(canvas, play, view) {
      Object.assign(this, { play, view, pen: canvas.getContext("2d"), lines: view.ground(), local: play.shapes.map(T.local), calls: 0 });
      const of = (kind) => play.shapes.map((s, k) => [s, this.local[k]]).filter(([s]) => kind(s.kind));
      this.rods = of((k) => k === "rod");
      this.balls = of((k) => k === "ball");
      this.rims = of((k) => k === "disc" || k === "cone");
    }

    theme(colours) { this.colours = colours; }

    resize(width, height, ratio) { Object.assign(this, { width, height }); T.sized(this.pen, width, height, ratio); }

    calm() {}

    draw({ motions, exact, cells, solid, trails }) {
      const { pen, view, colours } = this, players = this.play.players;
      this.calls = 0;
      pen.clearRect(0, 0, this.width, this.height);
      view.aim();
      this.pixels = view.pixels;
      pen.lineCap = "round";
      for (const cell of cells) {
        pen.save();
        pen.beginPath();
        pen.rect(cell.x, cell.y, cell.w, cell.h);
        pen.clip();
        pen.translate(cell.x, cell.y);
        this.stroke(this.lines.map((l) => l.map((p) => view.place(p))), colours.rule, 1, 1);
        this.dots(this.play.ground.map((p) => view.place(p)), 3, colours.muted, 1);
        for (const p of cell.players) this.path(trails[p], players[p].colour);
        if (exact) this.path(trails[players.length], colours.ink);
        for (const p of cell.players) this.player(motions[p], players[p].colour, cell.players.length === 1 || p === solid ? 1 : 0.4, view.least);
        if (exact) this.bars(exact, colours.ink, 1, 0, 0.6);
        pen.restore();
      }
    }

    player(motion, colour, alpha, least) {
      const place = (s) => this.view.place(motion.point(s.body, s.a));
      for (const [s, l] of this.rims) this.rim(motion, s, l, colour, alpha);
      this.bars(motion, colour, alpha, least, alpha < 1 ? 0.8 : 1);
      const first = this.balls[0];
      if (first) this.dots(this.balls.map(([s]) => place(s)), Math.max(first[0].radius, 1.3 * least) * this.pixels, colour, alpha);
    }

    // all rods of a motion, as thick as the first
    bars(motion, colour, alpha, least, slim) {
      if (!this.rods.length) return;
      const ends = this.rods.map(([s]) => [this.view.place(motion.point(s.body, s.a)), this.view.place(motion.point(s.body, s.b))]);
      this.stroke(ends, colour, least ? 2 * Math.max(this.rods[0][0].radius, least) * this.pixels * slim : 1.2, alpha);
    }

    // a disc is its upper rim, a cone its rim and lines to its tip
    rim(motion, s, l, colour, alpha) {
      const { pen } = this, end = s.kind === "cone" ? -0.5 : 0.5, place = (at) => this.view.place(motion.point(s.body, at)), tip = place(s.a);
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

    // lines through places, as one path
    stroke(lines, colour, width, alpha) {
      const { pen } = this;
      Object.assign(pen, { globalAlpha: alpha, strokeStyle: colour, lineWidth: width });
      pen.beginPath();
      for (const line of lines) {
        let begun = false;
        for (const p of line) {
          if (p && begun) pen.lineTo(p[0], p[1]);
          else if (p) pen.moveTo(p[0], p[1]);
          begun = Boolean(p);
        }
      }
      pen.stroke();
      this.calls++;
    }

    dots(places, radius, colour, alpha) {
      const { pen } = this;
      Object.assign(pen, { globalAlpha: alpha, fillStyle: colour });
      pen.beginPath();
      for (const p of places) if (p) { pen.moveTo(p[0] + radius, p[1]); pen.arc(p[0], p[1], radius, 0, 2 * Math.PI); }
      pen.fill();
      this.calls++;
    }

    path(trail, colour) {
      if (!trail) return;
      const { path, from, to, head } = trail, points = [];
      for (let k = from; k <= to + 1; k++) points.push(this.view.place(k > to ? head : path.subarray(3 * k, 3 * k + 3)));
      this.stroke([points], colour, 1.2, 0.8);
    }

    facts() { return { renderer: "2-D canvas", calls: this.calls, triangles: 0, lines: 0 }; }
  };
})();
