// Poses at any time, from those stored as reports/mechanism/theatre/packing.py does.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});

  // columns from 0 up -> rows of values about 0, one row a pose
  const rowsOf = (values, frames) => {
    const columns = values.length / frames, out = new Int16Array(values.length);
    values.forEach((v, k) => { out[(k % frames) * columns + Math.floor(k / frames)] = v - 32767; });
    return out;
  };

  // A player with its motion: at(t) fills `body` with 12 numbers a body, the columns of R and then r.
  T.Motion = class {
    constructor(player, play) {
      this.t = MBS.numbers(player.t);
      this.n = player.frames;
      this.rows = rowsOf(MBS.numbers(player.poses), player.frames);
      this.bodies = play.bodies;
      this.middle = play.middle;
      this.quantum = play.quantum;
      this.body = new Float32Array(12 * play.bodies);
      this.k = 0;
    }

    // the last stored pose that is not after t; times are asked for mostly in order
    index(t) {
      if (this.t[this.k] > t || this.k >= this.n) this.k = 0;
      if (this.k + 8 < this.n && this.t[this.k + 8] <= t) {
        let low = this.k, high = this.n - 1;
        while (low < high) {
          const half = (low + high + 1) >> 1;
          if (this.t[half] <= t) low = half; else high = half - 1;
        }
        this.k = low;
      }
      while (this.k + 1 < this.n && this.t[this.k + 1] <= t) this.k++;
      return this.k;
    }

    at(t) {
      const k = this.index(t), j = Math.min(k + 1, this.n - 1), gap = this.t[j] - this.t[k];
      const u = gap > 0 ? Math.min(Math.max((t - this.t[k]) / gap, 0), 1) : 0;
      const { rows, body, middle: m, quantum: h } = this, width = 7 * this.bodies;
      for (let b = 0; b < this.bodies; b++) {
        const p = k * width + 7 * b, q = j * width + 7 * b, o = 12 * b;
        for (let c = 0; c < 3; c++) body[o + 9 + c] = m[c] + h[c] * (rows[p + c] + u * (rows[q + c] - rows[p + c]));
        this.turn(rows, p + 3, q + 3, u, o);
      }
      return body;
    }

    // on the great circle between two quaternions (x, y, z, w), as a matrix
    turn(rows, p, q, u, o) {
      let x = rows[p], y = rows[p + 1], z = rows[p + 2], w = rows[p + 3];
      if (u > 0) {
        const X = rows[q], Y = rows[q + 1], Z = rows[q + 2], W = rows[q + 3];
        const dot = (x * X + y * Y + z * Z + w * W) / (32767 * 32767);
        let f = 1 - u, g = dot < 0 ? -u : u;
        if (Math.abs(dot) < 0.9995) {
          const angle = Math.acos(Math.abs(dot)), sine = Math.sin(angle);
          f = Math.sin((1 - u) * angle) / sine;
          g = (Math.sin(u * angle) / sine) * (dot < 0 ? -1 : 1);
        }
        x = f * x + g * X; y = f * y + g * Y; z = f * z + g * Z; w = f * w + g * W;
      }
      const s = 2 / (x * x + y * y + z * z + w * w), R = this.body;
      R[o] = 1 - s * (y * y + z * z); R[o + 1] = s * (x * y + z * w); R[o + 2] = s * (x * z - y * w);
      R[o + 3] = s * (x * y - z * w); R[o + 4] = 1 - s * (x * x + z * z); R[o + 5] = s * (y * z + x * w);
      R[o + 6] = s * (x * z + y * w); R[o + 7] = s * (y * z - x * w); R[o + 8] = 1 - s * (x * x + y * y);
    }

    // a point of a body in space, from the last at(t), into out at i
    point(b, s, out = [], i = 0) {
      const R = this.body, o = 12 * b;
      for (let c = 0; c < 3; c++) out[i + c] = R[o + c] * s[0] + R[o + 3 + c] * s[1] + R[o + 6 + c] * s[2] + R[o + 9 + c];
      return out;
    }

    // where a point goes, one place a stored pose
    path(b, s) {
      const out = new Float32Array(3 * this.n);
      this.t.forEach((t, f) => { this.at(t); this.point(b, s, out, 3 * f); });
      return out;
    }
  };
})();
