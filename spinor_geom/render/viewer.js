// Views of surfaces, lines and points in one page: plain WebGL, nothing is fetched.
(function () {
  "use strict";
  const SCALE = JSON.parse(document.getElementById("colours").textContent);
  const STOPS = SCALE.stops.map(rgb), UNKNOWN = rgb(SCALE.unknown);
  const SPACE = `uniform mat3 turn; uniform vec3 centre; uniform vec2 size; uniform float nearer;
    vec4 seen(vec3 p) { vec3 q = turn * (p - centre); return vec4(q.xy * size, -0.4 * q.z - nearer, 1.0); }`;
  const SURFACE = [`attribute vec3 position, normal, colour; varying vec3 n, c; ${SPACE}
    void main() { n = turn * normal; c = colour; gl_Position = seen(position); }`,
  `precision highp float; varying vec3 n, c; uniform vec4 inside; uniform float lit;
    void main() { vec3 m = normalize(n); if (m.z < 0.0) m = -m;
      float light = 0.42 + 0.4 * m.z + 0.26 * max(dot(m, vec3(-0.4, 0.6, 0.69)), 0.0);
      vec3 tint = mix(c, inside.rgb, gl_FrontFacing ? 0.0 : inside.a);
      gl_FragColor = vec4(tint * mix(1.0, light, lit), 1.0); }`, ["position", "normal", "colour"]];
  const EDGE = [`attribute vec3 position; ${SPACE} void main() { gl_Position = seen(position); }`,
    `precision highp float; uniform vec3 colour; void main() { gl_FragColor = vec4(colour, 0.7); }`, ["position"]];
  const STROKE = [`attribute vec3 start, end; attribute vec2 corner; uniform vec2 pixels; uniform float width; ${SPACE}
    void main() { vec4 a = seen(start), b = seen(end); vec2 along = (b.xy - a.xy) * pixels;
      float length_ = length(along); vec2 u = length_ > 0.0 ? along / length_ : vec2(1.0, 0.0);
      gl_Position = mix(a, b, corner.x);
      gl_Position.xy += (vec2(-u.y, u.x) * corner.y + u * (corner.x * 2.0 - 1.0) * 0.5) * width / pixels; }`,
  EDGE[1].replace("0.7", "1.0"), ["start", "end", "corner"]];
  const DOT = [`attribute vec3 position; uniform float width; ${SPACE}
    void main() { gl_Position = seen(position); gl_PointSize = width; }`,
  `precision highp float; uniform vec3 colour;
    void main() { vec2 d = gl_PointCoord - 0.5; if (dot(d, d) > 0.25) discard; gl_FragColor = vec4(colour, 1.0); }`, ["position"]];

  // --- data ----------------------------------------------------------------------------------------------------------

  function rgb(text) { return [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16)); }
  let arrays = [];
  function decode(place, Type) {
    const letters = atob(arrays[place]), bytes = new Uint8Array(letters.length);
    for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
    return new Type(bytes.buffer);
  }
  function colourOf(value, low, high) {
    if (!Number.isFinite(value)) return UNKNOWN;
    const x = Math.min(Math.max((value - low) / (high - low || 1), 0), 1) * (STOPS.length - 1);
    const k = Math.min(Math.floor(x), STOPS.length - 2);
    return STOPS[k].map((a, i) => a + (x - k) * (STOPS[k + 1][i] - a));
  }
  function normalsOf(p, faces) {
    const sum = new Float32Array(p.length);
    for (let f = 0; f < faces.length; f += 3) {
      const a = faces[f] * 3, b = faces[f + 1] * 3, c = faces[f + 2] * 3;
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      // as unit vectors' sums: products of tiny edges are below what float32 holds
      const size = Math.hypot(nx, ny, nz) || 1;
      for (const at of [a, b, c]) { sum[at] += nx / size; sum[at + 1] += ny / size; sum[at + 2] += nz / size; }
    }
    return sum;
  }
  function edgesOf(faces) {
    const seen = new Set(), list = [];
    for (let f = 0; f < faces.length; f += 3)
      for (let k = 0; k < 3; k++) {
        const a = faces[f + k], b = faces[f + ((k + 1) % 3)], key = a < b ? a * 4294967296 + b : b * 4294967296 + a;
        if (!seen.has(key)) { seen.add(key); list.push(a, b); }
      }
    return new Uint32Array(list);
  }
  function told(value) {
    const size = Math.abs(value);
    return value === 0 ? "0" : size >= 1e-3 && size < 1e5 ? String(Number(value.toPrecision(3))) : value.toExponential(1);
  }

  // the largest |cos t a + sin t b| over all t
  function longest(a, b) {
    const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    return Math.sqrt((dot(a, a) + dot(b, b)) / 2 + Math.hypot((dot(a, a) - dot(b, b)) / 2, dot(a, b)));
  }

  // --- a layer on the graphics card ----------------------------------------------------------------------------------

  function program(gl, [vertex, fragment, names]) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
    }
    names.forEach((name, k) => gl.bindAttribLocation(made, k, name));
    gl.linkProgram(made);
    return (name) => { if (name === undefined) { gl.useProgram(made); return made; } return gl.getUniformLocation(made, name); };
  }
  function store(gl, kind, data, old) {
    const made = old || gl.createBuffer();
    gl.bindBuffer(kind, made); gl.bufferData(kind, data, gl.STATIC_DRAW);
    return made;
  }
  function feed(gl, buffers) {
    buffers.forEach(([made, size], k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, made); gl.enableVertexAttribArray(k); gl.vertexAttribPointer(k, size, gl.FLOAT, false, 0, 0);
    });
    for (let k = buffers.length; k < 3; k++) gl.disableVertexAttribArray(k);
  }

  class Layer {
    constructor(gl, data, place) {
      Object.assign(this, data);
      this.gl = gl;
      this.place = place;  // points of space to points of the view
      this.own = decode(data.vertices, Float32Array);
      this.other = data.conjugate !== undefined ? decode(data.conjugate, Float32Array) : null;
      this.list = data.elements !== undefined ? decode(data.elements, Uint32Array) : null;
      this.rgb = rgb(data.colour).map((x) => x / 255);
      this.back = data.inside ? [...rgb(data.inside).map((x) => x / 255), 1] : [0, 0, 0, 0];
      if (data.kind === "faces") {
        this.elements = store(gl, gl.ELEMENT_ARRAY_BUFFER, this.list);
        this.normal = store(gl, gl.ARRAY_BUFFER, normalsOf(place(this.own), this.list));
        this.paint(null);
      }
      if (data.kind === "lines") this.ribbon();
      this.turnTo(0);
    }
    // two triangles for each line: WebGL draws lines one pixel wide
    ribbon() {
      const count = this.list.length / 2, corners = new Float32Array(8 * count), elements = new Uint32Array(6 * count);
      for (let k = 0; k < count; k++) {
        corners.set([0, -1, 0, 1, 1, -1, 1, 1], 8 * k);
        elements.set([0, 1, 2, 1, 3, 2].map((x) => x + 4 * k), 6 * k);
      }
      this.corner = store(this.gl, this.gl.ARRAY_BUFFER, corners);
      this.elements = store(this.gl, this.gl.ELEMENT_ARRAY_BUFFER, elements);
    }
    turnTo(angle) {
      const gl = this.gl, points = this.place(this.own, this.other, angle);
      if (this.kind !== "lines") { this.position = store(gl, gl.ARRAY_BUFFER, points, this.position); return; }
      const count = this.list.length / 2, start = new Float32Array(12 * count), end = new Float32Array(12 * count);
      for (let k = 0; k < count; k++) {
        const a = 3 * this.list[2 * k], b = 3 * this.list[2 * k + 1];
        for (let j = 0; j < 12; j++) { start[12 * k + j] = points[a + (j % 3)]; end[12 * k + j] = points[b + (j % 3)]; }
      }
      this.start = store(gl, gl.ARRAY_BUFFER, start, this.start);
      this.end = store(gl, gl.ARRAY_BUFFER, end, this.end);
    }
    paint(field, scale) {
      const text = field ? this.fields[field] : undefined, count = this.own.length / 3;
      const colours = new Float32Array(3 * count), values = text !== undefined ? decode(text, Float32Array) : null;
      for (let k = 0; k < count; k++) {
        const c = values ? colourOf(values[k], scale.low, scale.high) : null;
        for (let i = 0; i < 3; i++) colours[3 * k + i] = c ? c[i] / 255 : this.rgb[i];
      }
      this.painted = store(this.gl, this.gl.ARRAY_BUFFER, colours, this.painted);
    }
    edgeElements() {
      if (!this.edgeList) {
        const edges = edgesOf(this.list);
        this.edgeCount = edges.length;
        this.edgeList = store(this.gl, this.gl.ELEMENT_ARRAY_BUFFER, edges);
      }
      return this.edgeList;
    }
  }

  // --- turning -------------------------------------------------------------------------------------------------------

  // 3×3 matrices, row after row
  const product = (a, b) => a.map((_, k) => [0, 1, 2].reduce((sum, j) => sum + a[3 * Math.floor(k / 3) + j] * b[3 * j + (k % 3)], 0));
  const aboutX = (t) => [1, 0, 0, 0, Math.cos(t), -Math.sin(t), 0, Math.sin(t), Math.cos(t)];
  const aboutY = (t) => [Math.cos(t), 0, Math.sin(t), 0, 1, 0, -Math.sin(t), 0, Math.cos(t)];
  const aboutZ = (t) => [Math.cos(t), -Math.sin(t), 0, Math.sin(t), Math.cos(t), 0, 0, 0, 1];
  const columns = (m) => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];

  class View {
    constructor(host, data) {
      Object.assign(this, data);
      this.host = host;
      this.on = new Set();
      this.chosen = "";
      this.build();
      const gl = this.gl = this.canvas.getContext("webgl", { alpha: false, antialias: true, preserveDrawingBuffer: true });
      if (!gl || !gl.getExtension("OES_element_index_uint")) { this.note.textContent = "this browser has no WebGL"; this.works = false; return; }
      this.works = true;
      this.programs = { faces: program(gl, SURFACE), edges: program(gl, EDGE), lines: program(gl, STROKE), dots: program(gl, DOT) };
      gl.enable(gl.DEPTH_TEST); gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      this.measure();
      this.parts = data.layers.map((layer) => new Layer(gl, layer, (own, other, angle) => this.placed(own, other, angle)));
      data.layers = null;
      this.reset();
      this.listen();
    }

    build() {
      const make = (kind, parent) => parent.appendChild(document.createElement(kind));
      make("figcaption", this.host).textContent = this.title;
      const stage = make("div", this.host);
      stage.className = "stage";
      this.canvas = make("canvas", stage);
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "img");
      this.canvas.setAttribute("aria-label", `${this.title}: ${this.flat ? "drag to move" : "drag to turn, with Shift to move"}, wheel or + and − to zoom, arrow keys, 0 to start again`);
      this.note = make("span", this.host);
      if (this.unit) {
        this.ruler = make("div", stage);
        this.ruler.className = "ruler";
        this.rule = make("i", this.ruler);
        this.length = make("span", this.ruler);
      }
      const names = Object.keys(this.scales);
      if (this.panel === null && names.length) {
        this.choice = document.createElement("select");
        this.choice.setAttribute("aria-label", "colours");
        for (const name of names) this.choice.add(new Option(name, name));
        this.host.insertBefore(this.choice, this.note);
        this.choice.addEventListener("change", () => this.show(this.choice.value));
      }
      if (this.layers.some((layer) => layer.conjugate !== undefined)) {
        const label = make("label", this.host), say = () => { said.textContent = `${this.angle.value}°`; };
        label.append("θ ");
        this.angle = make("input", label);
        const said = make("output", label);
        Object.assign(this.angle, { type: "range", min: "0", max: "360", step: "1", value: "0" });
        this.angle.setAttribute("aria-label", "angle of the associate family in degrees");
        say();
        this.angle.addEventListener("input", () => {
          for (const part of this.parts) if (part.other) part.turnTo(this.angle.value * Math.PI / 180);
          say(); this.draw();
        });
      }
    }

    // the middle of all layers and the largest distance from it, of all members of a family
    measure() {
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      const own = this.layers.map((layer) => decode(layer.vertices, Float32Array));
      for (const p of own) for (let k = 0; k < p.length; k++) { low[k % 3] = Math.min(low[k % 3], p[k]); high[k % 3] = Math.max(high[k % 3], p[k]); }
      this.middle = low.map((x, i) => (x + high[i]) / 2);
      this.radius = 1e-30;
      own.forEach((p, number) => {
        const place = this.layers[number].conjugate, other = place !== undefined ? decode(place, Float32Array) : null;
        for (let k = 0; k < p.length; k += 3) {
          const arm = [0, 1, 2].map((i) => p[k + i] - this.middle[i]);
          const away = other ? [0, 1, 2].map((i) => other[k + i] - this.middle[i]) : [0, 0, 0];
          this.radius = Math.max(this.radius, longest(arm, away));
        }
      });
    }
    placed(own, other, angle) {
      const made = new Float32Array(own.length), c = other ? Math.cos(angle) : 1, s = other ? Math.sin(angle) : 0;
      for (let k = 0; k < own.length; k++) {
        const m = this.middle[k % 3];
        made[k] = (c * (own[k] - m) + (other ? s * (other[k] - m) : 0)) / this.radius;
      }
      return made;
    }

    reset() {
      const camera = this.cameras[this.chosen] || this.cameras[""];
      this.still = !this.spins || matchMedia("(prefers-reduced-motion: reduce)").matches;
      this.turn = camera ? camera.frame.slice() : this.flat ? [1, 0, 0, 0, 1, 0, 0, 0, 1] : product(aboutX(-1), aboutZ(0.6));
      this.centre = camera ? camera.focus.map((x, i) => (x - this.middle[i]) / this.radius) : [0, 0, 0];
      this.zoom = camera ? 0.92 * this.radius / camera.radius : 0.9;
    }
    orbit(x, y) { this.turn = product(product(aboutX(y), aboutY(x)), this.turn); this.draw(); }
    // by shares of the picture's half height
    move(x, y) {
      for (let i = 0; i < 3; i++) this.centre[i] -= (x * this.turn[i] + y * this.turn[3 + i]) / this.zoom;
      this.draw();
    }
    grow(factor) { this.zoom *= factor; this.draw(); }

    listen() {
      const canvas = this.canvas;
      let held = null;
      canvas.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; this.still = true; canvas.setPointerCapture(event.pointerId); });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
      canvas.addEventListener("pointermove", (event) => {
        if (!held) return;
        const dx = event.clientX - held[0], dy = event.clientY - held[1], half = canvas.clientHeight / 2;
        held = [event.clientX, event.clientY];
        if (this.flat || event.shiftKey || event.buttons === 2) this.move(dx / half, -dy / half); else this.orbit(dx / 150, dy / 150);
      });
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.grow(Math.exp(-event.deltaY / 600)); }, { passive: false });
      canvas.addEventListener("dblclick", () => { this.reset(); this.draw(); });
      canvas.addEventListener("keydown", (event) => {
        const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
        if (arrow) { this.still = true; if (this.flat || event.shiftKey) this.move(0.1 * arrow[0], -0.1 * arrow[1]); else this.orbit(0.1 * arrow[0], 0.1 * arrow[1]); }
        else if (event.key === "+" || event.key === "=") this.grow(1.15);
        else if (event.key === "-") this.grow(1 / 1.15);
        else if (event.key === "0") { this.reset(); this.draw(); }
        else return;
        event.preventDefault();
      });
      let seen = true;
      new IntersectionObserver((entries) => { seen = entries[0].isIntersecting; }).observe(canvas);
      new ResizeObserver(() => this.draw()).observe(canvas);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
      const spin = () => {
        if (!this.still && seen) { this.turn = product(this.turn, aboutZ(0.004)); this.draw(); }
        requestAnimationFrame(spin);
      };
      if (this.spins) spin();
    }

    show(field, on, loop) {
      const scale = this.scales[field];
      if (field !== this.field) for (const part of this.parts) if (part.kind === "faces") part.paint(scale ? field : null, scale);
      this.field = field;
      if (on) this.on = on;
      if (loop !== undefined && loop !== this.chosen) { this.chosen = loop; this.reset(); }
      if (this.choice && scale) bar(this.note, scale);
      this.draw();
    }

    draw() {
      const gl = this.gl, canvas = this.canvas, fine = window.devicePixelRatio || 1;
      const width = Math.round(canvas.clientWidth * fine), height = Math.round(canvas.clientHeight * fine);
      if (!width || !height) return;
      if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
      gl.viewport(0, 0, width, height);
      const paper = getComputedStyle(document.body).backgroundColor.match(/[\d.]+/g).map((x) => x / 255);
      gl.clearColor(paper[0], paper[1], paper[2], 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const size = [this.zoom * Math.min(1, height / width), this.zoom * Math.min(1, width / height)];
      const use = (name, nearer) => {
        const at = this.programs[name];
        at();
        gl.uniformMatrix3fv(at("turn"), false, columns(this.turn));
        gl.uniform3f(at("centre"), ...this.centre);
        gl.uniform2f(at("size"), ...size);
        gl.uniform1f(at("nearer"), nearer / Math.max(this.zoom, 1));
        return at;
      };
      for (const part of this.parts) {
        if (part.loop !== "" && part.loop !== this.chosen) continue;
        if (part.switch && !this.on.has(part.switch)) continue;
        if (part.kind === "faces") {
          const at = use("faces", 0);
          gl.uniform4f(at("inside"), ...(part.fields[this.field] !== undefined ? [0, 0, 0, 0] : part.back));
          gl.uniform1f(at("lit"), this.flat ? 0 : 1);
          feed(gl, [[part.position, 3], [part.normal, 3], [part.painted, 3]]);
          gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.elements);
          gl.drawElements(gl.TRIANGLES, part.list.length, gl.UNSIGNED_INT, 0);
          if (part.edges === true || this.on.has(part.edges)) {
            const edge = use("edges", 0.003);
            gl.uniform3f(edge("colour"), 0.22, 0.24, 0.29);
            feed(gl, [[part.position, 3]]);
            gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.edgeElements());
            gl.drawElements(gl.LINES, part.edgeCount, gl.UNSIGNED_INT, 0);
          }
        } else if (part.kind === "lines") {
          const at = use("lines", 0);
          gl.uniform2f(at("pixels"), width / 2, height / 2);
          feed(gl, [[part.start, 3], [part.end, 3], [part.corner, 2]]);
          gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.elements);
          const strokes = [[part.rgb, part.width, 0.0045]];
          if (part.halo) strokes.unshift([rgb(part.halo).map((x) => x / 255), part.width + 2, 0.004]);
          for (const [colour, thick, nearer] of strokes) {
            gl.uniform3f(at("colour"), ...colour);
            gl.uniform1f(at("width"), thick / 2 * fine);
            gl.uniform1f(at("nearer"), nearer / Math.max(this.zoom, 1));
            gl.drawElements(gl.TRIANGLES, 3 * part.list.length, gl.UNSIGNED_INT, 0);
          }
        } else {
          const at = use("dots", 0.006);
          gl.uniform3f(at("colour"), ...part.rgb);
          gl.uniform1f(at("width"), part.size * fine);
          feed(gl, [[part.position, 3]]);
          gl.drawArrays(gl.POINTS, 0, part.own.length / 3);
        }
      }
      if (this.ruler) this.measureOut(Math.min(canvas.clientWidth, canvas.clientHeight) / 2 * this.zoom / this.radius);
    }

    // a round length of about a quarter of the picture; `scale` in CSS pixels per unit
    measureOut(scale) {
      const wanted = this.canvas.clientWidth / 4 / scale, power = 10 ** Math.floor(Math.log10(wanted));
      const round = power * [5, 2, 1].find((digit) => digit * power <= wanted);
      this.rule.style.width = `${round * scale}px`;
      this.length.textContent = `${told(round)} ${this.unit}`;
    }
  }

  // the colours' scale: a strip, its ends, their unit
  function bar(element, scale) {
    element.className = "bar";
    const strip = document.createElement("i"), high = document.createElement("b");
    strip.style.background = `linear-gradient(to right, ${STOPS.map((c) => `rgb(${c})`).join(", ")})`;
    high.textContent = `${told(scale.high)} ${scale.unit}`;
    element.replaceChildren(strip, high, `${told(scale.low)} ${scale.unit}`);
  }

  function follow(form, views) {
    const name = form.dataset.panel;
    const update = () => {
      const said = new FormData(form), field = said.get("colour") || "", loop = said.get("loop") || "";
      for (const view of views) view.show(field, new Set(said.getAll("show")), loop);
      const scale = views.map((view) => view.scales[field]).find(Boolean), output = form.querySelector("output");
      if (scale) bar(output, scale); else output.replaceChildren();
      for (const part of document.querySelectorAll(`[data-panel-of="${name}"]`)) part.hidden = part.dataset.loop !== loop;
    };
    form.addEventListener("change", update);
    form.addEventListener("submit", (event) => event.preventDefault());
    update();
  }

  document.addEventListener("DOMContentLoaded", () => {
    arrays = JSON.parse(document.getElementById("arrays").textContent);
    const views = JSON.parse(document.getElementById("views").textContent).map((data) => new View(document.getElementById(data.place), data));
    const working = views.filter((view) => view.works);
    for (const view of working) if (view.panel === null) view.show(Object.keys(view.scales)[0] || "");
    for (const form of document.querySelectorAll("form[data-panel]")) follow(form, working.filter((view) => view.panel === form.dataset.panel));
    document.title = (working.length === views.length ? "ready: " : "no WebGL: ") + document.title;
  });
})();
