// Mechanisms on small canvases: runs over the exact motion, as reports/mechanism/stage.py stores them.
(() => {
  const MBS = window.MBS, OFFSET = 4 * 4095, SHORTEST = 6, quiet = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const list = (a) => (a && a.kind ? MBS.numbers(a) : a);
  const opened = (play) => ({ ...play, exact: play.exact && { ...play.exact, lines: list(play.exact.lines) }, players: play.players.map((p) => ({ ...p, lines: list(p.lines), off: list(p.off) })) });

  // what is drawn on `canvas` at the picture `k` of `play`
  const paint = (canvas, play, k, thin) => {
    const pen = canvas.getContext("2d"), ratio = Math.min(devicePixelRatio || 1, 2), w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) Object.assign(canvas, { width: Math.round(w * ratio), height: Math.round(h * ratio) });
    const [wide, tall] = play.size, scale = Math.min(w / wide, h / tall), left = (w - scale * wide) / 2, top = (h - scale * tall) / 2;
    const x = (v) => left + scale * (v - OFFSET), y = (v) => top + scale * (tall - v + OFFSET), n = play.frames;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, w, h);
    pen.lineCap = pen.lineJoin = "round";
    pen.fillStyle = MBS.colour("--muted");
    for (const [a, b] of play.ground) pen.fillRect(x(a + OFFSET) - 3, y(b + OFFSET) - 3, 6, 6);
    const segments = (lines, count, colour, width, alpha) => {
      Object.assign(pen, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha });
      pen.beginPath();
      const j = Math.min(k, count - 1);
      for (let c = 0; c < lines.length / count; c += 4) {
        pen.moveTo(x(lines[c * count + j]), y(lines[(c + 1) * count + j]));
        pen.lineTo(x(lines[(c + 2) * count + j]), y(lines[(c + 3) * count + j]));
      }
      pen.stroke();
    };
    [...play.players].reverse().forEach((p, i, all) => segments(p.lines, n, p.colour, thin ? 1.5 : 3 + 2.5 * (all.length - 1 - i === 0 ? 0.6 : 1.4), 0.75));
    const known = play.exact ? Math.round((play.exact.until / play.t) * (n - 1)) : -1;
    if (play.exact && k <= known) segments(play.exact.lines, play.exact.frames, MBS.colour("--ink"), thin ? 1.4 : 1.8, 1);
    pen.globalAlpha = 1;
  };

  MBS.stage = opened;
  MBS.paint = paint;
  MBS.quiet = quiet;
  // plays on a canvas until another one takes it; `told` hears of each picture
  MBS.playing = (canvas, button, told) => {
    let play = null, at = 0, on = false, before = 0;
    const draw = () => { if (!play) return; const k = Math.min(Math.round((at / play.t) * (play.frames - 1)), play.frames - 1); paint(canvas, play, k); told(play, k, at); };
    const step = (now) => {
      if (!on) return;
      at = (at + Math.min(play.t / SHORTEST, 1) * Math.min((now - before) / 1000, 0.1)) % play.t;
      before = now;
      draw();
      requestAnimationFrame(step);
    };
    const run = (go) => { on = go; before = performance.now(); button.textContent = on ? "❚❚ Pause" : "▶ Play"; if (on) requestAnimationFrame(step); };
    button.hidden = false;
    button.addEventListener("click", () => run(!on));
    new ResizeObserver(draw).observe(canvas);
    MBS.onTheme(draw);
    return { show: (next) => { play = next; at = quiet ? play.t * 0.99 : 0; draw(); run(!quiet); }, seek: (t) => { run(false); at = t; draw(); }, play: () => play };
  };

  const off = (v, unit) => (!Number.isFinite(v) ? "not known" : unit !== "m" ? `${MBS.number(v, 2)} ${unit}` : v >= 1 ? `${v.toFixed(2)} m` : v >= 1e-5 ? `${(1000 * v).toFixed(v < 1e-3 ? 2 : 0)} mm` : v > 0 ? `${MBS.number(1000 * v, 1)} mm` : "0 mm");
  // a canvas with its button, clock and counters
  MBS.scene = (canvas, cast) => {
    const box = canvas.parentElement, clock = box.querySelector("[data-clock]");
    return MBS.playing(canvas, box.querySelector("[data-play]"), (play, k, at) => {
      clock.textContent = `${at.toFixed(1)} of ${MBS.number(play.t, 2)} s`;
      cast.querySelectorAll("[data-off]").forEach((b, i) => { const p = play.players[i]; if (p) b.textContent = p.stopped && at >= p.last ? "★ stopped" : `${play.unit === "m" ? "position" : "orientation"} error ${off(p.off[k], play.unit)}`; });
    });
  };
  // where nothing else plays on it
  if (!MBS.overview) for (const canvas of document.querySelectorAll("canvas[data-stage]")) {
    const cast = canvas.parentElement.parentElement.querySelector("[data-cast]");
    MBS.unpack(MBS[canvas.dataset.stage]).then((raw) => { MBS.onStage = MBS.scene(canvas, cast); MBS.onStage.show(MBS.stage(raw)); });
  }
})();
