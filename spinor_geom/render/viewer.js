// Rotating views of coloured meshes in one page: plain WebGL, nothing is fetched.
(function () {
  "use strict";
  const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const PLAIN = [143, 179, 217];
  const VERTEX = `attribute vec3 position, normal, colour, conjugate; uniform mat4 turn; uniform vec3 size; uniform vec2 family;
    varying vec3 n, c;
    void main() { vec4 p = turn * vec4(family.x * position + family.y * conjugate, 1.0); n = mat3(turn) * normal; c = colour;
      gl_Position = vec4(p.x * size.x, p.y * size.y, -0.4 * p.z - size.z, 1.0); }`;
  const FRAGMENT = `precision mediump float; varying vec3 n, c;
    void main() { float light = 0.35 + 0.65 * abs(normalize(n).z); gl_FragColor = vec4(c * light, 1.0); }`;
  const LINE = `precision mediump float; varying vec3 n, c; void main() { gl_FragColor = vec4(c, 1.0); }`;

  function decode(text, Type) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new Type(bytes.buffer);
  }
  function colourOf(value, low, high) {
    if (!Number.isFinite(value)) return [190, 190, 190];
    const x = Math.min(Math.max((value - low) / (high - low || 1), 0), 1) * (STOPS.length - 1);
    const k = Math.min(Math.floor(x), STOPS.length - 2);
    return STOPS[k].map((a, i) => a + (x - k) * (STOPS[k + 1][i] - a));
  }
  function normals(points, faces) {
    const sum = new Float32Array(points.length);
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [faces[f] * 3, faces[f + 1] * 3, faces[f + 2] * 3];
      const u = [0, 1, 2].map((i) => points[b + i] - points[a + i]), v = [0, 1, 2].map((i) => points[c + i] - points[a + i]);
      const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      for (const at of [a, b, c]) for (let i = 0; i < 3; i++) sum[at + i] += cross[i];
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
  function program(gl, fragment) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
    }
    ["position", "normal", "colour", "conjugate"].forEach((name, k) => gl.bindAttribLocation(made, k, name));
    gl.linkProgram(made);
    return made;
  }

  // of cos t a + sin t b over all t
  function longest(a, b) {
    const [aa, ab, bb] = [[a, a], [a, b], [b, b]].map(([u, v]) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2]);
    return Math.sqrt((aa + bb) / 2 + Math.hypot((aa - bb) / 2, ab));
  }

  function show(host, view) {
    const points = decode(view.vertices, Float32Array), faces = decode(view.faces, Uint32Array);
    const low = [0, 1, 2].map((i) => Infinity), high = [0, 1, 2].map((i) => -Infinity);
    for (let k = 0; k < points.length; k++) { low[k % 3] = Math.min(low[k % 3], points[k]); high[k % 3] = Math.max(high[k % 3], points[k]); }
    const middle = low.map((x, i) => (x + high[i]) / 2);
    const other = view.conjugate ? decode(view.conjugate, Float32Array) : new Float32Array(points.length).map((_, k) => middle[k % 3]);
    let radius = 1e-30;
    for (let k = 0; k < points.length; k += 3) {
      const arm = [0, 1, 2].map((i) => points[k + i] - middle[i]), away = [0, 1, 2].map((i) => other[k + i] - middle[i]);
      radius = Math.max(radius, view.conjugate ? longest(arm, away) : Math.hypot(...arm));
    }
    for (const list of [points, other]) for (let k = 0; k < list.length; k++) list[k] = (list[k] - middle[k % 3]) / radius;

    const title = document.createElement("figcaption"), canvas = document.createElement("canvas");
    const choice = document.createElement("select"), scale = document.createElement("span");
    title.textContent = view.title;
    canvas.width = canvas.height = 560;
    for (const name of Object.keys(view.fields)) choice.add(new Option(name, name));
    host.append(title, canvas, choice, scale);

    const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("OES_element_index_uint")) { scale.textContent = "this browser has no WebGL"; return false; }
    const surface = program(gl, FRAGMENT), line = program(gl, LINE), edges = edgesOf(faces);
    const buffer = (kind, data) => { const b = gl.createBuffer(); gl.bindBuffer(kind, b); gl.bufferData(kind, data, gl.STATIC_DRAW); return b; };
    const attribute = (data, k) => { buffer(gl.ARRAY_BUFFER, data); gl.enableVertexAttribArray(k); gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0); };
    attribute(points, 0); attribute(normals(points, faces), 1);  // the members of a family have the same normals
    let family = [1, 0];
    if (view.conjugate) {
      attribute(other, 3);
      const slider = document.createElement("input"), label = document.createElement("label"), angle = document.createElement("output");
      Object.assign(slider, { type: "range", min: 0, max: 360, value: 0 });
      slider.addEventListener("input", () => {
        family = [Math.cos(slider.value * Math.PI / 180), Math.sin(slider.value * Math.PI / 180)];
        angle.textContent = `${slider.value}°`; draw();
      });
      angle.textContent = "0°"; label.append("θ ", slider, angle); host.append(label);
    }
    const faceBuffer = buffer(gl.ELEMENT_ARRAY_BUFFER, faces), edgeBuffer = buffer(gl.ELEMENT_ARRAY_BUFFER, edges);
    gl.enable(gl.DEPTH_TEST);

    function paint() {
      const field = view.fields[choice.value], colours = new Float32Array(points.length);
      const values = field ? decode(field.values, Float32Array) : null;
      for (let k = 0; k < points.length / 3; k++)
        (values ? colourOf(values[k], field.low, field.high) : PLAIN).forEach((c, i) => (colours[3 * k + i] = c / 255));
      attribute(colours, 2);
      scale.textContent = field ? ` ${field.low.toExponential(1)} (violet) to ${field.high.toExponential(1)} (yellow)` : "";
    }
    let around = 0.6, tilt = -1.0, zoom = 0.9, held = null, still = false;
    function draw() {
      const [ca, sa, ct, st] = [Math.cos(around), Math.sin(around), Math.cos(tilt), Math.sin(tilt)];
      const turn = [ca, ct * sa, st * sa, 0, -sa, ct * ca, st * ca, 0, 0, -st, ct, 0, 0, 0, 0, 1];
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(1, 1, 1, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      for (const [made, kind, list, count] of [[surface, gl.TRIANGLES, faceBuffer, faces.length], [line, gl.LINES, edgeBuffer, edges.length]]) {
        if (made === line && !view.edges) continue;
        gl.useProgram(made);
        gl.uniformMatrix4fv(gl.getUniformLocation(made, "turn"), false, turn);
        gl.uniform2f(gl.getUniformLocation(made, "family"), ...family);
        gl.uniform3f(gl.getUniformLocation(made, "size"), zoom, zoom, made === line ? 0.004 : 0);  // lines lie before their faces
        if (made === line) { gl.disableVertexAttribArray(2); gl.vertexAttrib3f(2, 0.25, 0.27, 0.32); } else gl.enableVertexAttribArray(2);
        gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, list);
        gl.drawElements(kind, count, gl.UNSIGNED_INT, 0);
      }
    }
    canvas.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; still = true; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      around += (event.clientX - held[0]) / 150; tilt += (event.clientY - held[1]) / 150;
      held = [event.clientX, event.clientY]; draw();
    });
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom *= Math.exp(-event.deltaY / 600); draw(); }, { passive: false });
    canvas.addEventListener("dblclick", () => { still = false; });
    choice.addEventListener("change", () => { paint(); draw(); });
    let seen = true;
    new IntersectionObserver((entries) => { seen = entries[0].isIntersecting; }).observe(canvas);
    paint(); draw();
    (function spin() { if (!still && seen) { around += 0.004; draw(); } requestAnimationFrame(spin); })();
    return true;
  }

  document.addEventListener("DOMContentLoaded", () => {
    const views = JSON.parse(document.getElementById("views").textContent);
    const shown = views.map((view) => show(document.getElementById(view.place), view));
    document.title = (shown.every(Boolean) ? "ready: " : "no WebGL: ") + document.title;
  });
})();
