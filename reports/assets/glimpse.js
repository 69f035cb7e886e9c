// The mechanism of the first page: two runs over each other on a small canvas, as reports/mechanism/glimpse.py stores them.
(async () => {
  const canvas = document.querySelector("[data-glimpse]");
  if (!canvas) return;
  const play = await MBS.unpack(MBS.glimpse), box = canvas.parentElement, button = box.querySelector("button"), clock = box.querySelector("output");
  const OFFSET = 4 * 4095, n = play.frames, pen = canvas.getContext("2d"), [wide, tall] = play.size;
  const players = play.players.map((p) => ({ ...p, lines: MBS.numbers(p.lines) }));
  const exact = play.exact && MBS.numbers(play.exact.path), known = exact ? exact.length / 2 : 0, TRAIL = 60; // pictures
  const quiet = matchMedia("(prefers-reduced-motion: reduce)").matches;
  let at = 0, running = false, before = 0, scale = 1, left = 0, top = 0;

  const fit = () => {
    const ratio = Math.min(devicePixelRatio || 1, 2), { width, height } = canvas.getBoundingClientRect();
    Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    scale = Math.min(width / wide, height / tall);
    [left, top] = [(width - scale * wide) / 2, (height - scale * tall) / 2];
    draw();
  };
  const x = (v) => left + scale * v, y = (v) => top + scale * (tall - v);
  const draw = () => {
    const k = Math.min(Math.round((at / play.t) * (n - 1)), n - 1);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.lineCap = pen.lineJoin = "round";
    pen.fillStyle = MBS.colour("--muted");
    for (const [a, b] of play.ground) pen.fillRect(x(a) - 4, y(b) - 4, 8, 8);
    // the first, the best, on top and thinner: where both agree both are seen
    [...players].reverse().forEach((p, i, all) => {
      const v = (c) => p.lines[c * n + k] - OFFSET, joints = new Set();
      Object.assign(pen, { strokeStyle: p.colour, fillStyle: p.colour, lineWidth: i === all.length - 1 ? 2.5 : 6, globalAlpha: i === all.length - 1 ? 1 : 0.55 });
      pen.beginPath();
      for (let c = 0; c < p.lines.length / n; c += 4) {
        pen.moveTo(x(v(c)), y(v(c + 1)));
        pen.lineTo(x(v(c + 2)), y(v(c + 3)));
        joints.add(c);
      }
      pen.stroke();
      for (const c of joints) { pen.beginPath(); pen.arc(x(v(c)), y(v(c + 1)), 3, 0, 7); pen.fill(); }
      if (p.stopped && at >= p.last) { pen.font = "22px sans-serif"; pen.fillText("★", x(v(0)), y(v(1))); }
    });
    pen.globalAlpha = 1;
    // the exact path of a point in ink, as far as it is known
    const e = (i) => [x(exact[i] - OFFSET), y(exact[known + i] - OFFSET)], last = Math.min(k, known - 1);
    if (known && k - last < TRAIL) {
      Object.assign(pen, { strokeStyle: MBS.colour("--ink"), fillStyle: MBS.colour("--ink"), lineWidth: 1.5 });
      pen.beginPath();
      for (let i = Math.max(k - TRAIL, 0); i <= last; i++) pen.lineTo(...e(i));
      pen.stroke();
      if (last === k) { pen.beginPath(); pen.arc(...e(k), 4, 0, 7); pen.fill(); }
    }
    clock.textContent = `${at.toFixed(1)} of ${MBS.number(play.t)} s`;
  };
  const step = (now) => {
    if (!running) return;
    at = (at + Math.min((now - before) / 1000, 0.1)) % play.t;
    before = now;
    draw();
    requestAnimationFrame(step);
  };
  const run = (on) => {
    running = on;
    before = performance.now();
    button.textContent = on ? "❚❚ Pause" : "▶ Play";
    if (on) requestAnimationFrame(step);
  };
  button.hidden = false;
  button.addEventListener("click", () => run(!running));
  new ResizeObserver(fit).observe(canvas);
  MBS.onTheme(draw);
  MBS.glimpsed = { seek: (t) => { run(false); at = t; draw(); }, play };
  at = quiet ? play.t : 0;
  fit();
  run(!quiet);
})();
