// Draws the scenes of a page with three.js. The page's element "data" has them as JSON, see Views in page.py.
(function () {
  "use strict";
  function make(kind, parent, attributes = {}, text = "") {
    const made = parent.appendChild(document.createElement(kind));
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.textContent = text;
    return made;
  }
  const { colours, arrays: texts, views: scenes } = JSON.parse(document.getElementById("data").textContent);
  const arrays = {}, loading = [];
  const STOPS = colours.stops.map((stop) => new THREE.Color(stop)), UNKNOWN = new THREE.Color(colours.unknown);

  function array(index, Type) {
    arrays[index] ||= new Type(Uint8Array.from(atob(texts[index]), (letter) => letter.charCodeAt(0)).buffer);
    return arrays[index];
  }
  const mixed = new THREE.Color();
  function colourOf(value, range) {
    if (!Number.isFinite(value)) return UNKNOWN;
    const share = (value - range.low) / (range.high - range.low || 1);
    const x = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1), step = Math.min(Math.floor(x), STOPS.length - 2);
    return mixed.lerpColors(STOPS[step], STOPS[step + 1], x - step);
  }
  function formatted(value) {
    const size = Math.abs(value);
    const plain = size === 0 || (size >= 1e-3 && size < 1e5);
    return plain ? String(Number(value.toPrecision(3))) : value.toExponential(1);
  }
  function showScale(element, name, { low, high, is_cut_below, is_cut_above }) {
    element.className = "bar";
    element.replaceChildren(name);
    make("i", element, { style: `background: linear-gradient(to right, ${colours.stops.join(", ")})` });
    make("b", element, {}, (is_cut_above ? "≥ " : "") + formatted(high));
    element.append((is_cut_below ? "≤ " : "") + formatted(low));
  }

  // one shader for all surfaces, lit from the eye and from above; the materials of three.js take seconds to compile
  // without a graphics card
  const surface = (lit) => new THREE.ShaderMaterial({
    uniforms: {
      inside: { value: new THREE.Vector4() }, lit: { value: lit }, image: { value: null }, textured: { value: 0 },
    },
    vertexShader: `varying vec3 n, c; varying vec2 place;
      void main() {
        n = normalMatrix * normal;
        c = color;
        place = uv;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: `varying vec3 n, c; varying vec2 place; uniform vec4 inside;
      uniform float lit, textured; uniform sampler2D image;
      void main() {
        vec3 m = normalize(n) * (n.z < 0.0 ? -1.0 : 1.0);
        float light = 0.42 + 0.4 * m.z + 0.26 * max(dot(m, vec3(-0.4, 0.6, 0.69)), 0.0);
        vec3 own = mix(c, texture2D(image, place).rgb, textured);
        vec3 tint = mix(own, inside.rgb, gl_FrontFacing ? 0.0 : inside.a);
        gl_FragColor = vec4(tint * mix(1.0, light, lit), 1.0);
      }`,
    vertexColors: true,
    side: THREE.DoubleSide,
    polygonOffset: true,  // lines on the surface stay visible
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });

  // lines of a width in pixels with round ends, not available in three.js; a point is a line of length 0
  const stroke = (colour, width, nearer) => new THREE.ShaderMaterial({
    uniforms: {
      colour: { value: new THREE.Color(colour) },
      width: { value: width },
      nearer: { value: nearer },
      pixels: { value: new THREE.Vector3() },  // half the canvas's width and height, and the device pixel ratio
    },
    vertexShader: `attribute vec3 start, end; uniform vec3 pixels; uniform float width, nearer; varying vec3 at;
      void main() {
        mat4 seen = projectionMatrix * modelViewMatrix;
        vec4 a = seen * vec4(start, 1.0), b = seen * vec4(end, 1.0);
        vec2 along = (b.xy - a.xy) * pixels.xy;
        float size = length(along), half_ = width / 2.0 * pixels.z;
        vec2 u = size > 0.0 ? along / size : vec2(1.0, 0.0);
        gl_Position = position.x < 0.0 ? a : b;
        gl_Position.xy += (u * position.x + vec2(-u.y, u.x) * position.y) * half_ / pixels.xy;
        gl_Position.z -= nearer / max(projectionMatrix[1][1], 1.0);
        at = vec3(position.x < 0.0 ? -1.0 : size / half_ + 1.0, position.y, size / half_);
      }`,
    fragmentShader: `uniform vec3 colour; varying vec3 at;
      void main() {
        vec2 d = vec2(at.x - clamp(at.x, 0.0, at.z), at.y);
        if (d.x != 0.0 && dot(d, d) > 1.0) discard;
        gl_FragColor = vec4(colour, 1.0);
      }`,
    side: THREE.DoubleSide,
  });

  class Layer {
    constructor(data, view) {
      Object.assign(this, data);
      this.view = view;
      this.group = new THREE.Group();
      this.elements = data.elements === undefined ? null : array(data.elements, Uint32Array);
      if (data.kind === "faces") this.buildFaces(); else this.buildStrokes();
    }
    buildFaces() {
      const geometry = this.geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(this.points(0), 3));
      geometry.setIndex(new THREE.BufferAttribute(this.elements, 1));
      geometry.computeVertexNormals();
      this.material = surface(this.view.flat ? 0 : 1);
      this.paint("");
      this.group.add(new THREE.Mesh(this.image ? this.textured() : geometry, this.material));
      const thin = { wireframe: true, color: "#383d4a", transparent: true, opacity: 0.45 };
      this.wires = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(thin));
      this.group.add(this.wires);
    }
    // triangles with corners of their own, for texture coordinates that differ along seams
    textured() {
      const geometry = this.geometry.toNonIndexed(), { image, textured } = this.material.uniforms;
      geometry.setAttribute("uv", new THREE.BufferAttribute(array(this.skin, Float32Array), 2));
      const picture = Object.assign(new Image(), { src: this.image });
      image.value = Object.assign(new THREE.Texture(picture), { wrapS: THREE.RepeatWrapping, wrapT: THREE.RepeatWrapping });
      textured.value = 1;
      loading.push(picture.decode().then(() => { image.value.needsUpdate = true; this.view.draw(); }));
      return geometry;
    }
    buildStrokes() {
      const geometry = this.geometry = new THREE.InstancedBufferGeometry();
      const count = array(this.vertices, Float32Array).length / 3;
      this.elements = this.elements || Uint32Array.from({ length: 2 * count }, (_, k) => k >> 1);
      this.ends = new THREE.InstancedInterleavedBuffer(this.gathered(0), 6);
      const corners = [-1, -1, 0, -1, 1, 0, 1, -1, 0, 1, 1, 0];
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
      geometry.setIndex([0, 1, 2, 1, 3, 2]);
      geometry.setAttribute("start", new THREE.InterleavedBufferAttribute(this.ends, 3, 0));
      geometry.setAttribute("end", new THREE.InterleavedBufferAttribute(this.ends, 3, 3));
      const add = (kind, renderOrder) =>
        this.group.add(Object.assign(new THREE.Mesh(geometry, kind), { renderOrder, frustumCulled: false }));
      if (this.halo) add(Object.assign(stroke(this.halo, this.width + 2, 0.0012), { depthWrite: false }), 1);
      add(stroke(this.colour, this.width, this.kind === "dots" ? 0.002 : 0.0014), 2);
    }
    // the vertices for an angle of the associate family
    points(angle) {
      const own = array(this.vertices, Float32Array), c = Math.cos(angle), s = Math.sin(angle);
      if (this.conjugate === undefined) return own.slice();
      const other = array(this.conjugate, Float32Array);
      return own.map((x, k) => c * x + s * other[k]);
    }
    gathered(angle) {
      const points = this.points(angle), made = new Float32Array(3 * this.elements.length);
      this.elements.forEach((place, k) => made.set(points.subarray(3 * place, 3 * place + 3), 3 * k));
      return made;
    }
    // the normals are the same in the whole family
    turnTo(angle) {
      const buffer = this.ends || this.geometry.attributes.position;
      buffer.array.set(this.ends ? this.gathered(angle) : this.points(angle));
      buffer.needsUpdate = true;
    }
    paint(field, range) {
      const index = this.fields[field], plain = new THREE.Color(this.colour);
      const values = index === undefined ? null : array(index, Float32Array);
      const shown = !values && this.skin === undefined && this.inside;
      const own = this.skin !== undefined && !this.image && !values;
      const painted = array(own ? this.skin : this.vertices, Float32Array).slice();
      for (let k = 0; 3 * k < painted.length && !own; k++)
        (values ? colourOf(values[k], range) : plain).toArray(painted, 3 * k);
      this.geometry.setAttribute("color", new THREE.BufferAttribute(painted, 3));
      this.material.uniforms.inside.value.set(...new THREE.Color(shown || plain).toArray(), shown ? 1 : 0);
    }
  }

  class View {
    constructor(data, renderer) {
      const host = document.getElementById(data.place);
      Object.assign(this, data, { renderer, host, on: new Set(), chosen: "" });
      this.build();
      this.scene = new THREE.Scene();
      this.pivot = new THREE.Group();  // rotates about the middle of the picture
      this.world = new THREE.Group();
      this.scene.add(this.pivot.add(this.world));
      this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, -8, 8);
      this.parts = this.layers.map((layer) => new Layer(layer, this));
      for (const part of this.parts) this.world.add(part.group);
      this.reset();
      this.listen();
    }

    build() {
      const turning = this.flat ? "drag to move" : "drag to turn, with Shift to move";
      const label = `${this.title}: ${turning}, wheel or + and − to zoom, arrow keys, 0 to reset`;
      make("figcaption", this.host, {}, this.title);
      const stage = make("div", this.host, { class: "stage" });
      this.canvas = make("canvas", stage, { tabindex: 0, role: "img", "aria-label": label });
      if (this.unit) {
        const ruler = make("div", stage, { class: "ruler" });
        [this.rule, this.length] = [make("i", ruler), make("span", ruler)];
      }
      this.numbers = this.labels.map(([at, text]) =>
        ({ at: new THREE.Vector3(...at), text, element: make("span", stage, { class: "number" }, text) }));
      if (!this.panel && Object.keys(this.scales).length) this.bar = make("span", this.host);
      if (this.layers.some((layer) => layer.conjugate !== undefined)) {
        const label = make("label", this.host, {}, "θ "), name = "angle of the associate family in degrees";
        const slider = make("input", label, { type: "range", min: 0, max: 360, value: 0, "aria-label": name });
        const output = make("output", label, {}, "0°");
        slider.addEventListener("input", () => {
          for (const part of this.parts) part.turnTo(slider.value * Math.PI / 180);
          output.textContent = `${slider.value}°`;
          this.draw();
        });
      }
    }

    reset() {
      const { focus, frame, radius } = this.cameras[this.chosen] || this.cameras[""];
      const basis = new THREE.Matrix4().makeBasis(...frame.map((row) => new THREE.Vector3(...row)));
      this.pivot.quaternion.setFromRotationMatrix(basis.transpose());
      this.world.position.set(...focus.map((x) => -x));
      this.camera.zoom = 0.92 / radius;
    }
    // rotates by angles, or moves by shares of half the picture's height
    drag(x, y, moves) {
      const turn = this.pivot.quaternion, shift = new THREE.Vector3(x, -y, 0).divideScalar(this.camera.zoom);
      if (moves) this.world.position.add(shift.applyQuaternion(turn.clone().invert()));
      else turn.premultiply(new THREE.Quaternion().setFromEuler(new THREE.Euler(y, x, 0)));
      this.draw();
    }
    grow(factor) { this.camera.zoom *= factor; this.draw(); }

    listen() {
      const canvas = this.canvas, on = (name, act, how) => canvas.addEventListener(name, act, how);
      let held = null;
      let pressed = null;
      on("pointerdown", (event) => { held = pressed = event; canvas.setPointerCapture(event.pointerId); });
      on("pointerup", (event) => {
        if (!pressed || Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) > 4) return;
        const loop = this.loopAt(event.offsetX, event.offsetY);
        if (loop !== undefined) this.picked?.(loop);
      });
      on("lostpointercapture", () => { held = null; });
      on("pointermove", (event) => {
        if (!held) return;
        const moves = this.flat || event.shiftKey || event.buttons === 2;
        const unit = moves ? canvas.clientHeight / 2 : 150;
        this.drag((event.clientX - held.clientX) / unit, (event.clientY - held.clientY) / unit, moves);
        held = event;
      });
      on("contextmenu", (event) => event.preventDefault());
      const wheel = (event) => { event.preventDefault(); this.grow(Math.exp(-event.deltaY / 600)); };
      on("wheel", wheel, { passive: false });
      on("dblclick", () => { this.reset(); this.draw(); });
      on("keydown", (event) => {
        const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
        const factor = { "+": 1.15, "=": 1.15, "-": 1 / 1.15 }[event.key];
        if (arrow) this.drag(arrow[0] / 10, arrow[1] / 10, this.flat || event.shiftKey);
        else if (factor) this.grow(factor);
        else if (event.key === "0") { this.reset(); this.draw(); }
        else return;
        event.preventDefault();
      });
      new ResizeObserver(() => this.draw()).observe(canvas);
    }

    // the loop of the rim within a few pixels of a point of the canvas, else of the patch there
    loopAt(x, y) {
      const { canvas, camera } = this, seen = new THREE.Vector3(), spot = new THREE.Vector2();
      let [nearest, found] = [REACH, undefined];
      for (const { kind, loop, vertices } of this.parts) {
        if (kind === "faces" || loop === undefined) continue;
        const points = array(vertices, Float32Array);
        for (let k = 0; k < points.length; k += 3) {
          this.world.localToWorld(seen.fromArray(points, k)).project(camera);
          const away = Math.hypot((seen.x + 1) / 2 * canvas.clientWidth - x, (1 - seen.y) / 2 * canvas.clientHeight - y);
          if (away < nearest) [nearest, found] = [away, loop];
        }
      }
      if (found !== undefined) return found;
      const ray = new THREE.Raycaster(), meshes = this.parts.filter((part) => part.kind === "faces");
      ray.setFromCamera(spot.set(2 * x / canvas.clientWidth - 1, 1 - 2 * y / canvas.clientHeight), camera);
      ray.ray.origin.addScaledVector(ray.ray.direction, camera.near);  // three.js begins in the middle, not at the front
      const hit = ray.intersectObjects(meshes.map((part) => part.group.children[0]), false)[0];
      return meshes.find((part) => hit && part.group.children[0] === hit.object)?.loop;
    }
    mark(loop) {
      for (const { text, element } of this.numbers) element.classList.toggle("chosen", text === loop);
      this.draw();
    }
    // shows a loop by its camera
    turnTo(loop) {
      if (!this.cameras[loop]) return;
      this.chosen = loop;
      this.reset();
      this.draw();
    }
    tint(loop, colour) {
      for (const part of this.parts)
        if (part.loop === loop && part.kind !== "faces")
          part.group.traverse(({ material }) => material?.uniforms?.colour?.value.set(colour));
      this.draw();
    }

    show(field, on = this.on, loop = this.chosen) {
      const range = this.scales[field], other = loop !== this.chosen;
      Object.assign(this, { on, chosen: loop });
      for (const part of this.parts) {
        part.group.visible = !part.switch || on.has(part.switch);
        if (part.kind !== "faces") continue;
        part.wires.visible = part.edges === true || on.has(part.edges);
        if (field !== this.field) part.paint(field, range);
      }
      this.field = field;
      if (this.bar && range) showScale(this.bar, field, range);
      if (other) this.reset();
      this.draw();
    }

    // all views share one WebGL canvas and copy from it: browsers limit their number
    draw() {
      const { canvas, renderer, camera } = this, fine = window.devicePixelRatio, drawn = renderer.domElement;
      const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.round(side * fine));
      const least = Math.min(width, height), right = width / least, top = height / least;
      if (!least) return;
      if (drawn.width < width || drawn.height < height)
        renderer.setSize(Math.max(drawn.width, width), Math.max(drawn.height, height), false);
      Object.assign(camera, { left: -right, right, top, bottom: -top }).updateProjectionMatrix();
      this.world.traverse(({ material }) => material?.uniforms?.pixels?.value.set(width / 2, height / 2, fine));
      renderer.setViewport(0, 0, width, height);
      renderer.render(this.scene, camera);
      Object.assign(canvas, { width, height });  // clears it
      canvas.getContext("2d").drawImage(drawn, 0, drawn.height - height, width, height, 0, 0, width, height);
      this.placeNumbers();
      if (this.unit) this.drawRuler(least / fine / 2 * camera.zoom / this.reach);
    }
    // numbers that would cover one before them are hidden; the chosen one comes first
    placeNumbers() {
      const { clientWidth, clientHeight } = this.canvas, shown = [];
      const isChosen = ({ element }) => element.classList.contains("chosen");
      for (const number of [...this.numbers].sort((a, b) => isChosen(b) - isChosen(a))) {
        const { at, text, element } = number, { x, y } = this.world.localToWorld(at.clone()).project(this.camera);
        const place = { x: x * clientWidth / 2, y: y * clientHeight / 2, half: 5 + 3.5 * text.length };
        element.style.left = `${50 + 50 * x}%`;
        element.style.top = `${50 - 50 * y}%`;
        element.hidden = Math.max(Math.abs(x), Math.abs(y)) > 1 ||
          shown.some((one) => Math.abs(one.x - place.x) < one.half + place.half && Math.abs(one.y - place.y) < LINE);
        if (!element.hidden) shown.push(place);
      }
    }
    // a ruler of a round length, about a quarter of the picture; `size`: CSS pixels per unit
    drawRuler(size) {
      const wanted = this.canvas.clientWidth / 4 / size, power = 10 ** Math.floor(Math.log10(wanted));
      const round = power * [5, 2, 1].find((digit) => digit * power <= wanted);
      this.rule.style.width = `${round * size}px`;
      this.length.textContent = `${formatted(round)} ${this.unit}`;
    }
  }

  const LINE = 19;  // pixels, the height of a number
  const REACH = 14;  // pixels, from a rim to a click on it
  // links the rows of tables to the loops in the views
  function link(views) {
    const rows = [...document.querySelectorAll("tr[data-row]")];
    const choose = (loop, turns) => {
      for (const row of rows) {
        row.classList.toggle("chosen", row.dataset.row === loop);
        if (row.dataset.row === loop && !turns) row.scrollIntoView({ block: "nearest" });
      }
      const select = document.querySelector("form.panel select");
      if (select && [...select.options].some((option) => option.value === loop) && select.value !== loop) {
        select.value = loop;
        select.form.dispatchEvent(new Event("change"));
      }
      for (const view of views) {
        view.mark(loop);
        if (turns) view.turnTo(loop);
      }
    };
    for (const view of views) view.picked = (loop) => choose(loop, false);
    for (const row of rows) {
      row.addEventListener("click", () => choose(row.dataset.row, true));
      row.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(row.dataset.row, true); });
    }
    const command = document.querySelector("[data-command]");
    if (command) plan(command, rows, views, choose);
  }
  // how each loop is to be filled, and the command for it
  function plan(command, rows, views, choose) {
    const ways = ["open", "film", "smooth"], colours = ["#1f3b73", "#f28e2b", "#2f7d4f"], chosen = {};
    // "0,2-9"
    const ranges = (numbers) => numbers.reduce((text, n, k) => {
      const [joins, ends] = [numbers[k - 1] === n - 1, numbers[k + 1] !== n + 1];
      return joins ? text + (ends ? `-${n}` : "") : `${text}${k ? "," : ""}${n}`;
    }, "");
    const write = () => {
      const options = ways.slice(1).map((way, k) => {
        const own = rows.map((row) => Number(row.dataset.row)).filter((n) => chosen[n] === k + 1);
        return own.length ? ` --${way} ${ranges(own)}` : "";
      });
      command.textContent = options.join("") ? command.dataset.command + options.join("") : "choose a loop first";
    };
    const fill = (loop, way) => {
      chosen[loop] = way;
      const button = rows.find((row) => row.dataset.row === loop).querySelector("button");
      button.textContent = ways[way];
      for (const view of views) view.tint(loop, colours[way]);
      write();
    };
    const next = (loop) => fill(loop, ((chosen[loop] || 0) + 1) % ways.length);
    // as the key a of the window: films for open holes; if none is open, all smooth; if all are smooth, all open
    const nextOfAll = () => {
      const holes = rows.filter((row) => !row.matches(".missed")).map((row) => row.dataset.row);
      const open = holes.filter((loop) => !chosen[loop]), way = holes.every((loop) => chosen[loop] === 2) ? 0 : 2;
      if (open.length) for (const loop of open) fill(loop, 1); else for (const loop of holes) fill(loop, way);
    };
    const head = make("th", document.createElement("tr"), { scope: "col" });
    make("button", head, { type: "button", "aria-label": "fill all holes" }, "all").addEventListener("click", nextOfAll);
    document.querySelector("tr")?.prepend(head);
    for (const row of rows) {
      const cell = document.createElement("td"), loop = row.dataset.row;
      row.prepend(cell);
      make("button", cell, { type: "button", "aria-label": `fill loop ${loop}` }, ways[0])
        .addEventListener("click", (event) => { event.stopPropagation(); choose(loop, false); next(loop); });
    }
    for (const view of views) view.picked = (loop) => { choose(loop, false); next(loop); };
    command.parentElement.querySelector("button").addEventListener("click", ({ target }) => {
      getSelection().selectAllChildren(command);
      target.textContent = document.execCommand("copy") ? "Copied" : "Copy with Ctrl+C";
    });
    write();
  }

  function follow(form, views) {
    const output = form.querySelector("output");
    const update = () => {
      const chosen = new FormData(form), field = chosen.get("colour") || "", loop = chosen.get("loop") || "";
      for (const view of views) view.show(field, new Set(chosen.getAll("show")), loop);
      const range = views.map((view) => view.scales[field]).find(Boolean);
      if (range) showScale(output, "", range); else output.replaceChildren();
      for (const part of document.querySelectorAll("[data-loop]")) part.hidden = part.dataset.loop !== loop;
    };
    form.addEventListener("change", update);
    form.addEventListener("submit", (event) => event.preventDefault());
    update();
  }

  let renderer = null;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch { /* reported in each view */ }
  const views = renderer ? scenes.map((one) => new View(one, renderer)) : [];
  if (!renderer)
    for (const { place } of scenes) document.getElementById(place).textContent = "this browser has no WebGL";
  for (const view of views) if (!view.panel) view.show(Object.keys(view.scales)[0] || "");
  for (const form of document.querySelectorAll("form.panel")) follow(form, views.filter((view) => view.panel));
  link(views);
  Promise.all(loading).then(() => { document.title = (renderer ? "ready: " : "no WebGL: ") + document.title; });
})();
