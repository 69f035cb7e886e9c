// The stage in WebGL: every kind of shape is an instanced mesh a player; a cell shows those of its players.
(() => {
  const T = ((window.MBS ||= {}).theatre ||= {});
  const GHOST = 0.34; // opacity
  const MANY = 600; // instances
  const SLIM = [0.84, 0.66, 0.52]; // ghosts are thinner than the solid player, so that it hides those that agree
  const CORE = 0.4; // the exact motion is a line inside the bars that agree with it

  const driver = (gl) => gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);

  // "" without WebGL 2, else who draws
  T.webgl = () => {
    const gl = document.createElement("canvas").getContext("webgl2");
    const name = gl ? driver(gl) : "";
    gl?.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  };
  T.slow = (name) => /swiftshader|llvmpipe|software|basic render/i.test(name); // pixels cost the processor's time

  // a shape's place in its body: columns of a 3 x 4 matrix that takes the unit shape there
  T.local = (s) => {
    if (s.kind === "ball") return [s.radius, 0, 0, 0, s.radius, 0, 0, 0, s.radius, ...s.a];
    const [a, b] = s.kind === "cone" ? [s.b, s.a] : [s.a, s.b]; // a cone's tip is up
    const u = b.map((x, k) => x - a[k]), length = Math.hypot(...u) || 1e-12, e = u.map((x) => x / length);
    const k = e.map(Math.abs).indexOf(Math.min(...e.map(Math.abs))), n = [0, 0, 0];
    n[k] = 1;
    const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    const across = cross(n, e), size = Math.hypot(...across), x = across.map((v) => (v / size) * s.radius), z = cross(x, e);
    return [...x, ...u, ...z, ...a.map((v, c) => 0.5 * (v + b[c]))];
  };

  T.Solid = class {
    constructor(canvas, play, view, slow) {
      Object.assign(this, { play, view, slow });
      this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !slow, alpha: true });
      this.renderer.autoClear = this.renderer.info.autoReset = false;
      this.scene = new THREE.Scene();
      this.light = new THREE.DirectionalLight(0xffffff, 2.1);
      this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.9), this.light, this.light.target);
      const many = play.shapes.length * play.players.length > MANY; // thin bodies then: fewer sides are not seen
      const geometry = {
        rod: new THREE.CylinderGeometry(1, 1, 1, many ? 6 : 14, 1, many), disc: new THREE.CylinderGeometry(1, 1, 1, 48, 1),
        cone: new THREE.ConeGeometry(1, 1, 48, 1, true), ball: many ? new THREE.SphereGeometry(1, 6, 4) : new THREE.SphereGeometry(1, 16, 10),
      };
      this.kinds = Object.keys(geometry).map((kind) => {
        const shapes = play.shapes.filter((s) => s.kind === kind);
        return { kind, shapes, local: new Float32Array(shapes.flatMap(T.local)), geometry: geometry[kind] };
      }).filter((k) => k.shapes.length);
      this.solid = new THREE.MeshLambertMaterial();
      this.ghost = new THREE.MeshLambertMaterial({ transparent: true, opacity: GHOST, depthWrite: false });
      this.ink = new THREE.MeshLambertMaterial({ color: 0, depthTest: false });
      this.sets = play.players.map((p) => this.meshes(this.kinds, this.solid, new THREE.Color(p.colour)));
      this.exact = play.exact ? this.meshes(this.kinds.filter((k) => k.kind === "rod"), this.ink, null) : [];
      for (const mesh of this.exact) mesh.renderOrder = 3;
      this.ground = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
      this.ground.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(view.ground().flat(2)), 3));
      this.scene.add(this.ground);
      this.feet(play.ground);
      this.trails = [...play.players, ...(play.exact ? [{ colour: "#000000" }] : [])].map((p) => { // the last: of the exact motion
        const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: p.colour, transparent: true, opacity: 0.85 }));
        line.frustumCulled = false;
        this.scene.add(line);
        return line;
      });
    }

    meshes(kinds, material, colour) {
      return kinds.map((kind) => {
        const mesh = new THREE.InstancedMesh(kind.geometry, material, kind.shapes.length);
        mesh.frustumCulled = mesh.visible = false;
        if (colour) kind.shapes.forEach((s, k) => mesh.setColorAt(k, colour.clone().multiplyScalar(s.tint)));
        mesh.instanceMatrix.setUsage?.(35048);
        mesh.kind = kind;
        this.scene.add(mesh);
        return mesh;
      });
    }

    // a small cone under every place that holds on to the ground
    feet(points) {
      const size = 0.022 * this.view.size / Math.max(1, Math.sqrt(points.length / 4));
      this.foot = new THREE.MeshLambertMaterial({ color: 0x888888 });
      const mesh = new THREE.InstancedMesh(new THREE.ConeGeometry(0.6, 1, 4), this.foot, Math.max(points.length, 1));
      mesh.count = points.length;
      mesh.frustumCulled = false;
      const up = this.view.up, hang = [up.x, up.y, up.z];
      points.forEach((p, k) => {
        const stands = this.play.high.reduce((s, h, c) => s + (0.5 * (h + this.play.low[c]) - p[c]) * hang[c], 0) > 0;
        const sign = stands || !this.view.heavy ? -1 : 1; // supports hold from above what hangs, from below what stands
        const m = T.local({ kind: "cone", a: p, b: p.map((x, c) => x + sign * size * hang[c]), radius: size });
        for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) mesh.instanceMatrix.array[16 * k + 4 * c + r] = r < 3 ? m[3 * c + r] : c === 3 ? 1 : 0;
      });
      this.scene.add(mesh);
    }

    theme({ ink, muted, rule }) {
      this.ink.emissive.set(ink);
      if (this.play.exact) this.trails[this.trails.length - 1].material.color.set(ink);
      this.ground.material.color.set(rule);
      this.foot.color.set(muted);
    }

    resize(width, height, ratio) {
      this.own = this.slow ? 1 : ratio;
      this.renderer.setPixelRatio(this.own);
      this.renderer.setSize(width, height, false);
      this.tall = height;
    }

    // where pixels are dear, only a picture that stands still gets many
    calm(still) {
      const ratio = this.slow && still ? 2 : this.own;
      if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    }

    // the instances of a motion, across `slim` times their width, but not too thin to be seen
    fill(meshes, body, slim) {
      for (const { kind, instanceMatrix } of meshes) {
        const out = instanceMatrix.array, { shapes, local } = kind, ball = kind.kind === "ball";
        for (let s = 0; s < shapes.length; s++) {
          const o = 12 * shapes[s].body, l = 12 * s, m = 16 * s;
          const wide = slim * Math.max(1, (ball ? 1.3 : 1) * this.view.least / shapes[s].radius);
          for (let c = 0; c < 4; c++) {
            const f = c === 3 || (c === 1 && !ball) ? 1 : wide;
            const x = local[l + 3 * c] * f, y = local[l + 3 * c + 1] * f, z = local[l + 3 * c + 2] * f;
            out[m + 4 * c] = body[o] * x + body[o + 3] * y + body[o + 6] * z;
            out[m + 4 * c + 1] = body[o + 1] * x + body[o + 4] * y + body[o + 7] * z;
            out[m + 4 * c + 2] = body[o + 2] * x + body[o + 5] * y + body[o + 8] * z;
            out[m + 4 * c + 3] = 0;
          }
          out[m + 12] += body[o + 9];
          out[m + 13] += body[o + 10];
          out[m + 14] += body[o + 11];
          out[m + 15] = 1;
        }
        instanceMatrix.needsUpdate = true;
      }
    }

    // motions have 12 numbers a body; of a cell with several players all but the solid one are ghosts
    draw({ motions, exact, cells, solid, trails }) {
      const { renderer, view } = this, last = this.play.players.length;
      renderer.info.reset();
      renderer.setScissorTest(false);
      renderer.clear();
      renderer.setScissorTest(true);
      this.light.position.copy(view.camera.position).addScaledVector(view.up, 0.6 * view.size);
      this.light.target.position.copy(view.centre);
      if (exact) this.fill(this.exact, exact.body, CORE);
      for (const cell of cells) {
        const ghost = (p) => cell.players.length > 1 && p !== solid;
        for (const p of cell.players) this.fill(this.sets[p], motions[p].body, ghost(p) ? SLIM[Math.min(this.play.players[p].rank, 2)] : 1);
        this.sets.forEach((meshes, p) => meshes.forEach((mesh) => {
          mesh.visible = cell.players.includes(p);
          mesh.material = ghost(p) ? this.ghost : this.solid;
          mesh.renderOrder = ghost(p) ? 2 : 1;
        }));
        for (const mesh of this.exact) mesh.visible = Boolean(exact);
        this.trails.forEach((line, p) => this.trail(line, p === last || cell.players.includes(p) ? trails[p] : null));
        const place = [cell.x, this.tall - cell.y - cell.h, cell.w, cell.h];
        renderer.setViewport(...place);
        renderer.setScissor(...place);
        renderer.render(this.scene, view.camera);
      }
    }

    // {path, from, to, head}: stored places from..to and then where the point is now
    trail(line, t) {
      line.visible = Boolean(t) && t.to >= t.from;
      if (!line.visible) return;
      let own = line.geometry.attributes.position;
      if (!own) {
        own = new THREE.BufferAttribute(new Float32Array(t.path.length + 3), 3);
        own.array.set(t.path);
        line.geometry.setAttribute("position", own);
      }
      if (line.lent !== undefined) own.array.set(t.path.subarray(3 * line.lent, 3 * line.lent + 3), 3 * line.lent);
      own.array.set(t.head, 3 * (t.to + 1));
      line.lent = t.to + 1;
      own.needsUpdate = true;
      line.geometry.setDrawRange(t.from, t.to - t.from + 2);
    }

    facts() {
      const { calls, triangles, lines } = this.renderer.info.render;
      return { renderer: `WebGL 2, ${driver(this.renderer.getContext())}`, calls, triangles, lines };
    }
  };
})();
