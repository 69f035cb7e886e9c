// The strips beside the stage: energy error, |phi|, |phi_dot|, step. Curves are drawn once; only the cursor moves.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});
  const LEFT = 52, RIGHT = 10, TOP = 20, GAP = 10, FOOT = 20;
  const DASH = [[], [6, 3], [2, 2], [7, 2, 2, 2]];
  const round = (span, n) => { // a step of 1, 2 or 5 that gives about n ticks
    const raw = span / n, p = 10 ** Math.floor(Math.log10(raw)), f = raw / p;
    return p * (f < 1.5 ? 1 : f < 3.5 ? 2 : f < 7.5 ? 5 : 10);
  };

  T.Strips = class {
    constructor(canvas, cursor, play, sought) {
      Object.assign(this, { cursor, play, pen: canvas.getContext("2d"), linear: false, from: 0, zoom: 1 });
      const n = play.spans;
      this.curves = play.players.map((p) => {
        const all = Float32Array.from(MBS.numbers(p.strips));
        let k = 0;
        const row = () => all.subarray(k * n, ++k * n);
        return play.strips.map((s) => { const first = row(); return s.both ? [first, row()] : [first, first]; });
      });
      const seek = (e) => sought(Math.min(Math.max((e.offsetX - LEFT) / (this.width - LEFT - RIGHT), 0), 1) * this.span + this.from);
      canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); this.held = true; seek(e); });
      canvas.addEventListener("pointermove", (e) => { if (this.held) seek(e); });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.held = false; });
    }

    // largest magnitude (or, of the step, largest value) of a strip in the span at t; null where there is none
    value(player, strip, t) {
      const [low, high] = this.curves[player][strip], p = this.play.players[player];
      if (t > p.last * (1 + 1e-9)) return null;
      for (let k = Math.min(Math.floor((t / this.play.t_end) * this.play.spans), this.play.spans - 1); k >= 0; k--) {
        if (!Number.isNaN(high[k])) return Math.max(Math.abs(low[k]), Math.abs(high[k]));
      }
      return null;
    }

    theme(colours) { this.colours = colours; }

    resize(width, height, ratio) {
      Object.assign(this, { width, height });
      T.sized(this.pen, width, height, ratio);
    }

    get span() { return this.play.t_end / this.zoom; }

    x(t) { return LEFT + ((t - this.from) / this.span) * (this.width - LEFT - RIGHT); }

    // the part of the time axis that is shown; turned over like a page when the cursor leaves it
    stretch(zoom, t) {
      this.zoom = zoom;
      this.from = Math.min(Math.max(t - 0.5 * this.span, 0), this.play.t_end - this.span);
    }

    left(t) { return this.zoom > 1 && !this.held && (t < this.from || t > this.from + this.span); }

    seek(t) { this.cursor.style.transform = `translateX(${this.x(t).toFixed(2)}px)`; }

    draw(shown, solid) {
      const { pen, play } = this, n = play.strips.length;
      pen.clearRect(0, 0, this.width, this.height);
      pen.font = "11px system-ui, sans-serif";
      const each = (this.height - FOOT - n * TOP - (n - 1) * GAP) / n;
      const tops = play.strips.map((_, s) => TOP + s * (each + TOP + GAP));
      tops.forEach((top, s) => this.panel(s, top, each, shown, solid, s === n - 1));
      const gaps = tops.flatMap((top) => [`transparent ${top}px`, `var(--ink) ${top}px`, `var(--ink) ${top + each}px`, `transparent ${top + each}px`]);
      this.cursor.style.background = `linear-gradient(${gaps})`; // not over the titles
    }

    range(s, shown, signed) {
      let low = Infinity, high = -Infinity;
      const feet = []; // of magnitudes all but the smallest 2 % are shown: rounding near zero would squeeze the rest
      this.curves.forEach((c, p) => {
        if (!shown[p]) return;
        for (let k = 0; k < this.play.spans; k++) {
          const a = c[s][0][k], b = c[s][1][k];
          if (Number.isNaN(b) || !Number.isFinite(a) || !Number.isFinite(b)) continue;
          if (signed) { low = Math.min(low, a); high = Math.max(high, b); continue; }
          const top = Math.max(Math.abs(a), Math.abs(b));
          if (top > 0) high = Math.max(high, top);
          if (s === this.steps) low = Math.min(low, a > 0 ? a : low);
          else if (top > 0) feet.push(top);
        }
      });
      if (feet.length) low = feet.sort((a, b) => a - b)[Math.floor(0.02 * feet.length)];
      if (low > high) return null;
      if (signed) return low === high ? [low - 1, high + 1] : [low - 0.06 * (high - low), high + 0.06 * (high - low)];
      const [a, b] = [Math.log10(low), Math.log10(high)];
      return [Math.max(a, b - 18) - 0.15, Math.max(b, a + 0.5) + 0.15];
    }

    get steps() { return this.play.strips.findIndex((s) => s.name === "dt"); }

    panel(s, top, tall, shown, solid, last) {
      const { pen, play, colours } = this, strip = play.strips[s], signed = strip.signed && this.linear;
      const right = this.width - RIGHT, range = this.range(s, shown, signed);
      pen.setLineDash([]);
      Object.assign(pen, { globalAlpha: 1, fillStyle: colours.ink, textAlign: "left", strokeStyle: colours.rule, lineWidth: 1 });
      const name = strip.signed && !signed ? `|${strip.symbol}|` : strip.symbol;
      pen.fillText(`${name} [${strip.unit}]`, LEFT, top - 6);
      pen.strokeRect(LEFT, top, right - LEFT, tall);
      this.times(top, tall, last);
      if (!range) {
        pen.fillStyle = colours.muted;
        pen.fillText("zero throughout, or nothing shown", LEFT + 8, top + tall / 2 + 4);
        return;
      }
      const y = (v) => top + tall * (1 - ((signed ? v : Math.log10(v)) - range[0]) / (range[1] - range[0]));
      this.levels(range, signed, y, right);
      pen.save();
      pen.beginPath();
      pen.rect(LEFT, top - 2, right - LEFT + 2, tall + 4);
      pen.clip();
      const order = T.order(shown, solid);
      for (const p of order) this.curve(s, p, y, signed, p === solid, top + tall);
      pen.restore();
      for (const p of order) this.star(s, p, y, signed, top, tall);
      if (s === 0) this.events(shown, top);
    }

    curve(s, p, y, signed, solid, floor) {
      const { pen, play } = this, [low, high] = this.curves[p][s], player = play.players[p];
      const points = [];
      const first = Math.floor((this.from / play.t_end) * play.spans) - 40, last = first + play.spans / this.zoom + 80;
      for (let k = 0; k < play.spans; k++) {
        if (Number.isNaN(high[k]) || k < first || k > last) continue;
        const x = this.x(((k + 0.5) / play.spans) * play.t_end);
        const both = signed || s === this.steps ? [low[k], high[k]] : [Math.max(Math.abs(low[k]), Math.abs(high[k]))];
        for (const v of both) {
          points.push([x, signed || v > 0 ? Math.min(y(v), floor + 3) : floor + 3]);
        }
      }
      Object.assign(pen, { strokeStyle: player.colour, globalAlpha: solid ? 1 : 0.75, lineWidth: solid ? 2.2 : 1.2 });
      pen.setLineDash(DASH[player.rank % DASH.length]);
      T.stroke(pen, points);
      pen.setLineDash([]);
    }

    star(s, p, y, signed, top, tall) {
      const player = this.play.players[p];
      if (!player.stopped || player.last < this.from || player.last > this.from + this.span) return;
      const v = this.value(p, s, player.last), { pen } = this;
      const at = v > 0 && !signed ? y(v) : top + tall / 2;
      const star = ["★", this.x(player.last), Math.min(Math.max(at, top + 5), top + tall) + 5];
      pen.save();
      Object.assign(pen, { globalAlpha: 1, font: "15px system-ui, sans-serif", textAlign: "center", lineWidth: 3,
        strokeStyle: this.colours.card, fillStyle: player.colour });
      pen.strokeText(...star);
      pen.fillText(...star);
      pen.restore();
    }

    events(shown, top) {
      const { pen } = this;
      Object.assign(pen, { globalAlpha: 0.9, textAlign: "center" });
      for (const m of this.play.players.flatMap((p) => p.marks)) {
        if (m.kind !== "event" || !shown[m.player] || m.t < this.from || m.t > this.from + this.span) continue;
        pen.fillStyle = this.play.players[m.player].colour;
        pen.fillText("◆", this.x(m.t), top + 2);
      }
      Object.assign(pen, { globalAlpha: 1, textAlign: "left" });
    }

    levels(range, signed, y, right) {
      const { pen, colours } = this, ticks = [];
      const step = signed ? round(range[1] - range[0], 4) : Math.max(1, Math.ceil((range[1] - range[0]) / 4));
      for (let v = Math.ceil(range[0] / step) * step; v <= range[1]; v += step) ticks.push(v);
      Object.assign(pen, { textAlign: "right", strokeStyle: colours.rule, fillStyle: colours.muted });
      for (const v of ticks) {
        const at = y(signed ? v : 10 ** v);
        T.stroke(pen, [[LEFT, at], [right, at]]);
        pen.fillText(signed ? MBS.number(Math.abs(v) < 1e-9 * step ? 0 : v, 2) : `10${MBS.raised(v)}`, LEFT - 5, at + 4);
      }
      const middle = 10 ** (0.5 * (range[0] + range[1]));
      if (!ticks.length) pen.fillText(MBS.number(middle, 2), LEFT - 5, y(middle) + 4);
      pen.textAlign = "left";
    }

    times(top, tall, labelled) {
      const { pen, colours } = this, step = round(this.span, this.width < 420 ? 4 : 8);
      Object.assign(pen, { textAlign: "center", strokeStyle: colours.rule, fillStyle: colours.muted });
      const end = this.from + this.span * (1 + 1e-9);
      for (let t = Math.ceil(this.from / step - 1e-9) * step; t <= end; t += step) {
        T.stroke(pen, [[this.x(t), top], [this.x(t), top + tall]]);
        if (labelled) pen.fillText(`${+t.toPrecision(6)}${t + step > end ? " s" : ""}`, Math.min(this.x(t), this.width - 16), top + tall + 14);
      }
      pen.textAlign = "left";
    }
  };
})();
