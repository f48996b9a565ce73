// Shows the page's surfaces; plain WebGL 1, no libraries. Coordinates are the camera's: x right, y down, z forward.
// Each viewer says in its attribute data-drawn how that went: "yes", "no surface", "no webgl" or "failed". One with the
// attribute data-live is given its surfaces one after the other: root.show(mesh).
document.querySelectorAll(".viewer").forEach(root => {
  "use strict";
  const canvas = root.querySelector("canvas");
  const hint = root.querySelector(".hint");
  let mesh = JSON.parse(root.querySelector("script").textContent);
  const say = (drawn, text) => { root.dataset.drawn = drawn; hint.textContent = text; };
  if (!mesh && !("live" in root.dataset)) { say("no surface", "There is no surface to show."); return; }
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) { say("no webgl", "This browser offers no WebGL: open the mesh file in a viewer instead."); return; }

  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));

  const vertexShader = `
    attribute vec3 p; attribute vec3 n; attribute vec3 c;
    uniform vec3 low, center; uniform float step; uniform mat3 turn; uniform vec2 scale, shift; uniform float away, radius;
    varying vec3 normal, color, object; varying float depth;
    void main() {
      vec3 x = low + step * p;
      depth = x.z;
      vec3 v = turn * (x - center);
      object = n;
      normal = turn * n;
      color = c;
      float w = away + v.z / radius;
      gl_Position = vec4(scale * vec2(v.x, -v.y) / radius + shift * w, v.z / radius / 4.0 * w, w);
    }`;
  const fragmentShader = `
    precision mediump float;
    uniform int mode; uniform vec2 range;
    varying vec3 normal, color, object; varying float depth;
    vec3 viridis(float t) {
      const vec3 a = vec3(0.2777, 0.0054, 0.3340), b = vec3(0.1050, 1.4046, 1.3845), c = vec3(-0.3308, 0.2148, 0.0950);
      const vec3 d = vec3(-4.6342, -5.7991, -19.3324), e = vec3(6.2282, 14.1799, 56.6905);
      const vec3 f = vec3(4.7763, -13.7451, -65.3530), g = vec3(-5.4354, 4.6458, 26.3124);
      return a + t * (b + t * (c + t * (d + t * (e + t * (f + t * g)))));
    }
    void main() {
      vec3 n = normalize(normal);
      // Both sides are lit alike, the back a little dimmer, so that a hole does not look like a bump.
      float front = n.z < 0.0 ? 1.0 : 0.6;
      if (n.z > 0.0) n = -n;
      float light = 0.16 + 0.80 * max(0.0, dot(n, vec3(-0.45, -0.55, -0.70))) + 0.22 * max(0.0, dot(n, vec3(0.77, 0.10, -0.63)));
      vec3 base = vec3(0.886, 0.867, 0.831) * light;
      if (mode == 1) base = color;
      if (mode == 2) base = viridis(clamp((range.y - depth) / (range.y - range.x), 0.0, 1.0)) * (0.35 + 0.75 * light);
      if (mode == 4) base = color * (0.35 + 0.75 * light);
      if (mode == 3) base = 0.5 + 0.5 * normalize(object) * vec3(1.0, -1.0, -1.0);
      gl_FragColor = vec4(base * front, 1.0);
    }`;
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) { say("failed", gl.getShaderInfoLog(shader)); return; }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  const uniform = name => gl.getUniformLocation(program, name);
  // Two buffers, whatever is put into them.
  const upload = [gl.ARRAY_BUFFER, gl.ELEMENT_ARRAY_BUFFER].map(target => {
    gl.bindBuffer(target, gl.createBuffer());
    return data => gl.bufferData(target, data, "live" in root.dataset ? gl.DYNAMIC_DRAW : gl.STATIC_DRAW);
  });
  const attribute = (name, type, normalized, offset) => {
    const location = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, type, normalized, 12, offset);
  };
  attribute("p", gl.UNSIGNED_SHORT, false, 0);
  attribute("n", gl.BYTE, true, 6);
  attribute("c", gl.UNSIGNED_BYTE, true, 9);

  // Center on the middle of the data, not of its bounding box: a few stray points must not push it aside. What moves
  // moves before a view that stands still.
  let vertexData, framed = false;
  const frame = () => {
    const coordinates = new DataView(vertexData.buffer);
    const axes = [[], [], []];
    for (let i = 0; i < mesh.vertices; i += 7)
      for (let a = 0; a < 3; a++) axes[a].push(mesh.low[a] + mesh.step * coordinates.getUint16(12 * i + 2 * a, true));
    axes.forEach(list => list.sort((p, q) => p - q));
    const at = (list, share) => list[Math.min(list.length - 1, Math.floor(share * list.length))];
    gl.uniform3fv(uniform("center"), axes.map(list => (at(list, 0.02) + at(list, 0.98)) / 2));
    gl.uniform1f(uniform("radius"), 0.5 * Math.hypot(...axes.map(list => at(list, 0.98) - at(list, 0.02))) || 1);
    gl.uniform2fv(uniform("range"), [at(axes[2], 0.02), at(axes[2], 0.98)]);
    framed = true;
  };
  const load = next => {
    mesh = next;
    vertexData = bytes(mesh.vertex_data);
    upload[0](vertexData);
    upload[1](bytes(mesh.face_data));
    gl.uniform3fv(uniform("low"), mesh.low);
    gl.uniform1f(uniform("step"), mesh.step);
    if (!framed) frame();
  };
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0.098, 0.110, 0.133, 1);

  const buttons = [...root.querySelectorAll("button[data-mode]")];
  let yaw, pitch, zoom, shift, mode = Number(buttons[0].dataset.mode), asked = false;
  const reset = () => { yaw = -0.38; pitch = 0.2; zoom = 1; shift = [0, 0]; };
  const draw = () => {
    asked = false;
    if (!mesh) return;
    const dense = Math.min(window.devicePixelRatio || 1, 2);
    const [w, h] = [Math.round(canvas.clientWidth * dense), Math.round(canvas.clientHeight * dense)];
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    gl.viewport(0, 0, w, h);
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    // Rx(pitch) · Ry(yaw), column by column.
    gl.uniformMatrix3fv(uniform("turn"), false, [cy, sp * sy, -cp * sy, 0, cp, sp, sy, -sp * cy, cp * cy]);
    const away = 3.2, fit = 0.92 * away * zoom;
    gl.uniform2f(uniform("scale"), fit * Math.min(1, h / w), fit * Math.min(1, w / h));
    gl.uniform2fv(uniform("shift"), shift);
    gl.uniform1f(uniform("away"), away);
    gl.uniform1i(uniform("mode"), mode);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawElements(gl.TRIANGLES, 3 * mesh.faces, gl.UNSIGNED_SHORT, 0);
    root.dataset.drawn = gl.getError() === gl.NO_ERROR ? "yes" : "failed";
  };
  const ask = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const zoomBy = factor => { zoom = Math.min(40, Math.max(0.2, zoom * factor)); ask(); };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", e => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, e => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", e => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const size = [canvas.clientWidth, canvas.clientHeight];
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== e.pointerId)[1];
      const span = p => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      zoomBy(span(now) / span(before));
      shift = [shift[0] + dx / size[0], shift[1] - dy / size[1]];
    } else if (e.shiftKey || e.buttons === 2) {
      shift = [shift[0] + 2 * dx / size[0], shift[1] - 2 * dy / size[1]];
    } else {
      yaw -= 0.008 * dx;
      pitch = Math.min(1.57, Math.max(-1.57, pitch + 0.008 * dy));
    }
    fingers.set(e.pointerId, now);
    ask();
  });
  canvas.addEventListener("contextmenu", e => e.preventDefault());
  canvas.addEventListener("wheel", e => { e.preventDefault(); zoomBy(Math.exp(-0.0015 * e.deltaY)); }, { passive: false });
  canvas.addEventListener("dblclick", () => { reset(); ask(); });
  canvas.addEventListener("keydown", e => {
    const keys = { ArrowLeft: () => yaw += 0.1, ArrowRight: () => yaw -= 0.1, ArrowUp: () => pitch -= 0.1,
      ArrowDown: () => pitch += 0.1, "+": () => zoomBy(1.2), "-": () => zoomBy(1 / 1.2) };
    if (keys[e.key]) { keys[e.key](); e.preventDefault(); ask(); }
  });
  buttons.forEach(button => button.addEventListener("click", () => {
    mode = Number(button.dataset.mode);
    buttons.forEach(b => b.setAttribute("aria-pressed", b === button));
    ask();
  }));
  root.querySelector("[data-reset]").addEventListener("click", () => { if (mesh) frame(); reset(); ask(); });
  window.addEventListener("resize", ask);
  root.show = next => { load(next); ask(); };
  reset();
  if (mesh) load(mesh);
  draw();
});
