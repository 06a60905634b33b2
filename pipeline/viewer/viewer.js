// The page's program. `npm install && npm run build` here bundles it with three.js into viewer.bundle.js.
import {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, DataTexture, DoubleSide, FloatType, GLSL3, Group, Matrix4, Mesh, MeshStandardMaterial,
  NearestFilter,
  OrthographicCamera, PerspectiveCamera, PlaneGeometry, RGBAFormat, RedFormat, Scene, ShaderMaterial, Spherical,
  Vector3, Vector4, WebGLRenderTarget, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

// For tests of the exported module, which is given three.js by whoever uses it.
const THREE = { AmbientLight, DataTexture, FloatType, Matrix4, MeshStandardMaterial, NearestFilter, RedFormat };

const started = performance.now();
const wood = JSON.parse(document.getElementById('wood').textContent);
const by = (id) => document.getElementById(id);

const VERTEX = `
out vec3 v_point;
out vec3 v_normal;
void main() {
  v_point = position;
  v_normal = normal;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const FRAGMENT = `
in vec3 v_point;
in vec3 v_normal;
out vec4 result;
uniform vec3 u_eye;
uniform vec3 u_up;
uniform vec4 u_cut;
uniform int u_mode;
uniform bool u_cutting;
uniform bool u_detail;
uniform bool u_probe;
uniform bool u_flat;

vec3 encoded(vec3 linear) {
  vec3 c = clamp(linear, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

vec3 wheel(float turn) {
  return 0.62 + 0.30 * cos(6.2831853 * (turn + vec3(0.0, 0.33, 0.67)));
}

// From dark blue over green to yellow, close to viridis.
vec3 scale(float t) {
  t = clamp(t, 0.0, 1.0);
  vec3 a = mix(vec3(0.27, 0.00, 0.33), vec3(0.23, 0.32, 0.55), smoothstep(0.0, 0.25, t));
  vec3 b = mix(a, vec3(0.13, 0.57, 0.55), smoothstep(0.25, 0.5, t));
  vec3 c = mix(b, vec3(0.37, 0.79, 0.38), smoothstep(0.5, 0.75, t));
  return mix(c, vec3(0.99, 0.91, 0.14), smoothstep(0.75, 1.0, t));
}

void main() {
  vec3 p = v_point;
  if (u_cutting && dot(u_cut.xyz, p) > u_cut.w) discard;
  vec3 towards = normalize(u_eye - p);
  vec3 n = u_flat ? normalize(cross(dFdx(p), dFdy(p))) : normalize(v_normal);
  if (dot(n, towards) < 0.0) n = -n;
  if (!gl_FrontFacing && u_cutting) {
    // A back side seen is the inside of the wood, opened by the cut: what shows is the plane.
    float along = (u_cut.w - dot(u_cut.xyz, u_eye)) / dot(u_cut.xyz, -towards);
    p = u_eye - along * towards;
    n = u_cut.xyz;
  }
  WpWood w = wp_wood(p, u_detail && u_mode == 0);
  if (u_probe) {
    result = vec4(w.age, w.lateness, w.confidence, 1.0);
    return;
  }
  vec3 key = normalize(towards + 0.9 * u_up + 0.55 * cross(u_up, towards));
  float lambert = max(dot(n, key), 0.0);
  float sky = 0.5 + 0.5 * dot(n, u_up);
  if (u_mode == 0) {
    float rough = mix(WP_ROUGH_EARLY, WP_ROUGH_LATE, clamp(w.lateness, 0.0, 1.0));
    float a = rough * rough;
    float h = max(dot(n, normalize(key + towards)), 0.0);
    float d = h * h * (a * a - 1.0) + 1.0;
    float gloss = 0.04 * a * a / (4.0 * d * d * max(0.2, dot(n, towards)));
    vec3 lit = w.rgb * (0.34 + 0.16 * sky + 0.72 * lambert) + vec3(gloss * lambert);
    result = vec4(encoded(lit), 1.0);
    return;
  }
  vec3 flat_color;
  if (u_mode == 1) {
    float ring = floor(w.age);
    float part = w.age - ring;
    float line = smoothstep(0.0, max(2.0 * fwidth(w.age), 1e-4), part);
    flat_color = wheel(fract(ring * 0.381966)) * (0.55 + 0.45 * line);
  } else if (u_mode == 2) {
    flat_color = mix(vec3(0.96, 0.90, 0.80), vec3(0.28, 0.14, 0.07), clamp(w.lateness, 0.0, 1.0));
  } else {
    flat_color = scale(w.confidence);
  }
  result = vec4(flat_color * (0.72 + 0.10 * sky + 0.22 * lambert), 1.0);
}`;

const EVALUATE = `
out vec4 result;
uniform highp sampler2D u_points;
uniform bool u_detail;
void main() {
  vec4 p = texelFetch(u_points, ivec2(gl_FragCoord.xy), 0);
  WpWood w = wp_wood(p.xyz, u_detail);
  result = vec4(w.rgb, w.age);
}`;

async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Float32Array(await new Response(stream).arrayBuffer());
}

function fail(message) {
  const note = by('problem');
  note.hidden = false;
  note.textContent = message;
}

async function main() {
  const canvas = by('view');
  const gl = canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    fail('This page draws with WebGL 2, which this browser does not offer. Try a current Firefox, Chrome, Edge or Safari.');
    return;
  }
  const probes = gl.getExtension('EXT_color_buffer_float') !== null;
  const renderer = new WebGLRenderer({ canvas, context: gl, antialias: true });
  renderer.setClearColor(0x000000, 0);
  const data = await unpacked(wood.tables);
  const tables = new DataTexture(data, wood.row, data.length / wood.row, RedFormat, FloatType);
  tables.minFilter = tables.magFilter = NearestFilter;
  tables.needsUpdate = true;

  const uniforms = {
    wp_tables: { value: tables }, u_eye: { value: new Vector3() }, u_up: { value: new Vector3(0, -1, 0) },
    u_cut: { value: new Vector4(0, 0, 1, 1e9) }, u_mode: { value: 0 }, u_cutting: { value: false },
    u_detail: { value: true }, u_probe: { value: false }, u_flat: { value: true },
  };
  const head = 'precision highp float;\nprecision highp int;\n';
  const material = new ShaderMaterial({
    glslVersion: GLSL3, uniforms, vertexShader: VERTEX, fragmentShader: head + wood.source + FRAGMENT, side: DoubleSide,
  });

  // Meshes keep to the board frame (y down, z away); the group turns it upright. Its origin is the block's middle.
  const low = new Vector3(...wood.low), high = new Vector3(...wood.high);
  const middle = low.clone().add(high).multiplyScalar(0.5), sides = high.clone().sub(low);
  const reach = 0.5 * sides.length();
  const group = new Group();
  group.matrixAutoUpdate = false;
  group.matrix.makeScale(1, -1, -1).multiply(new Matrix4().makeTranslation(-middle.x, -middle.y, -middle.z));
  const block = new BoxGeometry(sides.x, sides.y, sides.z).translate(middle.x, middle.y, middle.z);
  const body = new Mesh(block, material);
  group.add(body);
  const scene = new Scene();
  scene.add(group);
  const camera = new PerspectiveCamera(28, 1, 0.01 * reach, 40 * reach);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.minDistance = 0.3 * reach;
  controls.maxDistance = 16 * reach;
  const state = { extent: { low: low.clone(), high: high.clone() }, busy: 0, timer: 0, cost: 4e-6, frames: 0, full: 0 };

  function home() {
    const away = new Vector3().setFromSphericalCoords(1, 1.13, 0.55);
    const narrow = Math.min(1, camera.aspect);
    controls.target.set(0, 0, 0);
    camera.position.copy(away.multiplyScalar((2.1 * reach) / Math.tan((14 * Math.PI) / 180) / 2 / narrow));
    controls.update();
  }

  function render() {
    const inverse = group.matrix.clone().invert();
    uniforms.u_eye.value.copy(camera.position).applyMatrix4(inverse);
    uniforms.u_up.value.set(0, 1, 0).applyQuaternion(camera.quaternion).transformDirection(inverse);
    renderer.render(scene, camera);
  }

  // While things move, as many pixels as a fifth of a second allows; then all of them.
  function draw(whole) {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const finest = Math.min(window.devicePixelRatio || 1, 2);
    const affordable = Math.sqrt(0.2 / state.cost / (width * height));
    const ratio = whole ? finest : Math.max(0.15, Math.min(finest, affordable));
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    const start = performance.now();
    render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    const spent = (performance.now() - start) / 1000;
    if (state.frames > 0) state.cost = 0.5 * state.cost + (0.5 * spent) / (width * height * ratio * ratio);
    state.frames += 1;
    if (whole) state.full += 1;
    if (state.frames === 1) {
      state.first = performance.now() - started;
      document.body.dataset.ready = String(Math.round(state.first));
    }
  }

  function changed() {
    if (!state.busy) state.busy = requestAnimationFrame(() => { state.busy = 0; draw(false); });
    clearTimeout(state.timer);
    state.timer = setTimeout(() => draw(true), 220);
  }

  // The cut: one of the board's axes, and how far along it.
  function cut() {
    const axis = by('axis').value, share = Number(by('cut').value) / 100;
    uniforms.u_cutting.value = share > 0;
    const { low: a, high: b } = state.extent;
    const turned = { x: [1, 0, 0], y: [0, -1, 0], z: [0, 0, -1] }[axis];
    const from = { x: b.x, y: -a.y, z: -a.z }[axis], to = { x: a.x, y: -b.y, z: -b.z }[axis];
    uniforms.u_cut.value.set(...turned, from + (to - from) * share * 0.995);
    by('cut-value').textContent = share > 0 ? `${Math.round(100 * share)} %` : 'off';
    by('cut').setAttribute('aria-valuetext', by('cut-value').textContent);
    changed();
  }

  const probe = probes ? new WebGLRenderTarget(1, 1, { type: FloatType, format: RGBAFormat }) : null;
  function at(x, y) {
    if (!probe) return null;
    const box = canvas.getBoundingClientRect();
    camera.setViewOffset(box.width, box.height, x - box.left - 0.5, y - box.top - 0.5, 1, 1);
    uniforms.u_probe.value = true;
    renderer.setRenderTarget(probe);
    renderer.clear();
    render();
    const found = new Float32Array(4);
    renderer.readRenderTargetPixels(probe, 0, 0, 1, 1, found);
    renderer.setRenderTarget(null);
    uniforms.u_probe.value = false;
    camera.clearViewOffset();
    return found[3] > 0.5 ? { age: found[0], lateness: found[1], confidence: found[2] } : null;
  }

  let asked = 0;
  function tell(x, y) {
    const now = performance.now();
    if (now - asked < 90) return;
    asked = now;
    const found = at(x, y);
    by('readout').textContent = found ? words(found) : 'Point at the wood to read its rings.';
  }

  function words({ age, lateness, confidence }) {
    const ring = Math.floor(age), year = wood.years[String(ring)];
    const parts = [`ring ${ring}`];
    if (year !== undefined) parts.push(`year ${year}`);
    parts.push(`age ${age.toFixed(2)}`, lateness > 0.5 ? 'latewood' : 'earlywood', `confidence ${Math.round(100 * confidence)} %`);
    return parts.join(' \u00b7 ');
  }

  // A mesh of one's own: turned upright into the board frame, as large as fits the block.
  async function open(file) {
    try {
      const loaded = await new GLTFLoader().parseAsync(await file.arrayBuffer(), '');
      place(loaded.scene);
      by('readout').textContent = `${file.name}, cut from the wood`;
    } catch (error) {
      by('readout').textContent = `${file.name} cannot be read as a GLB (${error.message}); export it as one binary glTF file.`;
    }
  }

  function place(model) {
    model.updateMatrixWorld(true);
    const pieces = [];
    model.traverse((part) => {
      if (part.isMesh) {
        const geometry = part.geometry.index ? part.geometry.toNonIndexed() : part.geometry.clone();
        pieces.push(geometry.applyMatrix4(part.matrixWorld));
      }
    });
    const count = pieces.reduce((sum, piece) => sum + piece.attributes.position.count, 0);
    if (!count) throw new Error('it holds no triangles');
    const places = new Float32Array(3 * count);
    let start = 0;
    for (const piece of pieces) {
      for (let i = 0; i < piece.attributes.position.count; i += 1) {
        places[start] = piece.attributes.position.getX(i);
        places[start + 1] = -piece.attributes.position.getY(i);
        places[start + 2] = -piece.attributes.position.getZ(i);
        start += 3;
      }
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(places, 3));
    geometry.computeBoundingBox();
    const size = geometry.boundingBox.getSize(new Vector3()), centre = geometry.boundingBox.getCenter(new Vector3());
    const fit = 0.98 * Math.min(...['x', 'y', 'z'].map((axis) => sides[axis] / Math.max(size[axis], 1e-12)));
    geometry.translate(-centre.x, -centre.y, -centre.z).scale(fit, fit, fit).translate(middle.x, middle.y, middle.z);
    geometry.computeVertexNormals();
    geometry.computeBoundingBox();
    body.geometry = geometry;
    state.extent = { low: geometry.boundingBox.min.clone(), high: geometry.boundingBox.max.clone() };
    // Cuts and zoom follow the new size.
    controls.target.set(0, 0, 0);
    const radius = 0.5 * size.length() * fit;
    camera.position.setLength(radius * 4.4);
    controls.minDistance = 0.3 * radius;
    cut();
  }

  function reset() {
    body.geometry = block;
    state.extent = { low: low.clone(), high: high.clone() };
    controls.minDistance = 0.3 * reach;
    by('cut').value = '0';
    home();
    cut();
  }

  // For tests: the shader's own colors and ages at points of the board frame.
  function evaluate(points, detail = true) {
    const count = points.length / 3, width = Math.min(256, count), height = Math.ceil(count / width);
    const given = new Float32Array(4 * width * height);
    for (let i = 0; i < count; i += 1) given.set(points.slice(3 * i, 3 * i + 3), 4 * i);
    const places = new DataTexture(given, width, height, RGBAFormat, FloatType);
    places.needsUpdate = true;
    const shader = new ShaderMaterial({
      glslVersion: GLSL3, vertexShader: 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }',
      fragmentShader: head + wood.source + EVALUATE, depthTest: false,
      uniforms: { wp_tables: { value: tables }, u_points: { value: places }, u_detail: { value: detail } },
    });
    const sheet = new Scene();
    const quad = new Mesh(new PlaneGeometry(2, 2), shader);
    quad.frustumCulled = false;
    sheet.add(quad);
    const target = new WebGLRenderTarget(width, height, { type: FloatType, format: RGBAFormat });
    renderer.setRenderTarget(target);
    renderer.render(sheet, new OrthographicCamera(-1, 1, 1, -1, 0, 1));
    const out = new Float32Array(4 * width * height);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, out);
    renderer.setRenderTarget(null);
    return Array.from(out.slice(0, 4 * count));
  }

  for (const input of document.querySelectorAll('input[name=mode]')) {
    input.addEventListener('change', () => {
      uniforms.u_mode.value = Number(input.value);
      by('legend').textContent = input.dataset.legend;
      changed();
    });
  }
  by('cut').addEventListener('input', cut);
  by('axis').addEventListener('change', cut);
  by('detail').addEventListener('change', () => { uniforms.u_detail.value = by('detail').checked; changed(); });
  by('reset').addEventListener('click', reset);
  by('file').addEventListener('change', () => { if (by('file').files.length) open(by('file').files[0]); });
  document.addEventListener('dragover', (event) => event.preventDefault());
  document.addEventListener('drop', (event) => {
    event.preventDefault();
    if (event.dataTransfer.files.length) open(event.dataTransfer.files[0]);
  });
  controls.addEventListener('change', changed);
  canvas.addEventListener('pointermove', (event) => { if (!event.buttons) tell(event.clientX, event.clientY); });
  canvas.addEventListener('pointerdown', (event) => tell(event.clientX, event.clientY));
  canvas.addEventListener('keydown', (event) => {
    const step = { ArrowLeft: [0, -0.12], ArrowRight: [0, 0.12], ArrowUp: [-0.12, 0], ArrowDown: [0.12, 0] }[event.key];
    const zoom = { '+': 0.9, '=': 0.9, '-': 1.1 }[event.key];
    if (!step && !zoom) return;
    event.preventDefault();
    const offset = camera.position.clone().sub(controls.target);
    const around = new Spherical().setFromVector3(offset);
    if (step) { around.phi += step[0]; around.theta += step[1]; }
    if (zoom) around.radius = Math.min(controls.maxDistance, Math.max(controls.minDistance, around.radius * zoom));
    around.makeSafe();
    camera.position.copy(controls.target).add(offset.setFromSpherical(around));
    controls.update();
    const box = canvas.getBoundingClientRect();
    tell(box.left + 0.5 * box.width, box.top + 0.5 * box.height);
  });
  new ResizeObserver(() => changed()).observe(canvas);

  camera.aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
  home();
  cut();
  draw(false);
  window.woodpipe = { evaluate, at, draw, place, state, scene, camera, controls, uniforms, renderer, body, open, THREE };
}

main().catch((error) => fail(`The wood cannot be drawn: ${error.message}`));
