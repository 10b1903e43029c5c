// Draws surfaces and photos into the panels of one canvas, with one camera for all of them.
"use strict";

HarnessPage.createViewer = (canvas, onTurned) => {
  const { shaders, views } = HarnessPage;
  const MOST_KEPT = { full: 14, coarse: 60 };
  const REST_MS = 180, SLOW_MS = 100;
  // Without a graphics card smooth edges cost more than everything else.
  const isSoftware = /swiftshader|llvmpipe|software/i.test(graphicsName());
  // three.js itself asks for a canvas that may be clear. Some browsers show its clear parts in black.
  const asked = { alpha: false, antialias: !isSoftware, preserveDrawingBuffer: true, stencil: false };
  const renderer = new THREE.WebGLRenderer({ canvas, context: canvas.getContext("webgl2", asked) });
  renderer.autoClear = false;
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  renderer.outputColorSpace = "srgb-linear"; // shaders give display colours already

  const shared = { projection: { value: new THREE.Matrix4() }, worldToView: { value: new THREE.Matrix4() } };
  const look = {
    ...shared,
    mode: { value: 0 }, lit: { value: true }, limit: { value: 1 }, greatest: { value: 1 },
    ramp: { value: shaders.rampTexture() }, hasPhoto: { value: false }, photo: { value: null },
    photoDepth: { value: null }, photoFromWorld: { value: new THREE.Matrix4() },
  };
  const material = shaders.surfaceMaterial(look);
  const wire = shaders.wireMaterial(shared);
  const over = { photo: { value: null }, opacity: { value: 1 }, extent: { value: new THREE.Vector2(1, 1) }, down: { value: views.DOWN } };
  const body = new THREE.Mesh(new THREE.BufferGeometry(), material);
  const picture = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), shaders.pictureMaterial(over));
  const [bodyScene, pictureScene] = [body, picture].map((object) => {
    const scene = new THREE.Scene();
    object.frustumCulled = false;
    scene.matrixWorldAutoUpdate = false;
    scene.add(object);
    return scene;
  });

  const camera = new THREE.PerspectiveCamera(40, 1, 0.05, 50);
  const idle = new THREE.PerspectiveCamera(); // three asks for one; ours is in the uniforms
  canvas.addEventListener("wheel", (event) => {
    // A page that scrolls must not get caught: the wheel zooms only where the view has the focus.
    if (document.activeElement !== canvas) event.stopImmediatePropagation();
  }, { capture: true });
  const controls = new THREE.OrbitControls(camera, canvas);
  canvas.style.touchAction = "pan-y";
  controls.minDistance = 0.4;
  controls.maxDistance = 12;

  const surfaces = { full: new Map(), coarse: new Map() };
  let depths = new Map();
  const state = {
    subject: null, panels: [], view: 0, shading: "error", metric: "", limit: 1, light: true,
    wires: false, layout: "side", split: 0.5, overlay: 0,
  };
  let subject = { views: [], pictures: [], reach: [1, 1] };
  let askedAt = null;
  // While a view turns, coarse surfaces stand for full ones that cannot be drawn often enough.
  let isSlow = isSoftware, isMoving = false, resting = 0, isPrinting = false;

  controls.addEventListener("start", () => canvas.focus({ preventScroll: true }));
  controls.addEventListener("change", () => { leavePhoto(); moved(); });

  // A finger that scrolls the page past the view begins like one that turns it: the view goes back.
  let touched = null;
  canvas.addEventListener("pointerdown", () => {
    touched = { view: state.view, position: camera.position.clone(), target: controls.target.clone() };
  }, { capture: true });
  canvas.addEventListener("pointercancel", () => {
    if (!touched) return;
    camera.position.copy(touched.position);
    controls.target.copy(touched.target);
    controls.update();
    state.view = touched.view; // after update(), which tells of a change
    onTurned();
    request();
  });

  function graphicsName() {
    const gl = document.createElement("canvas").getContext("webgl2");
    if (!gl) throw new Error("no WebGL 2");
    const names = gl.getExtension("WEBGL_debug_renderer_info");
    const name = String(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  }

  function leavePhoto() {
    if (state.view === null) return;
    state.view = null;
    onTurned();
  }

  // ---- content

  function keep(key, decoded, form) {
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(decoded.indices, 1));
    geometry.setAttribute("position", new THREE.BufferAttribute(decoded.points, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(decoded.normals, 3));
    const none = new Float32Array(decoded.points.length / 3).fill(-1);
    const scalars = {};
    for (const [id, values] of Object.entries(decoded.scalars)) scalars[id] = new THREE.BufferAttribute(values, 1);
    const kept = surfaces[form];
    kept.set(key, {
      geometry, scalars, none: new THREE.BufferAttribute(none, 1), faces: decoded.indices.length / 3,
      greatest: decoded.greatest,
    });
    for (const [old, surface] of kept) {
      if (kept.size <= MOST_KEPT[form]) break;
      if (state.panels.some((name) => keyOf(name) === old)) continue;
      surface.geometry.dispose();
      kept.delete(old);
    }
  }

  const has = (name, form) => surfaces[form].has(keyOf(name));

  // What is drawn of a surface now; undefined where nothing of it has arrived.
  function formOf(name) {
    const full = surfaces.full.get(keyOf(name)), coarse = surfaces.coarse.get(keyOf(name));
    return (isSlow && isMoving && coarse) || full || coarse;
  }

  const keyOf = (name) => `${state.subject}\n${name}`;

  function setSubject(id, found, bitmaps) {
    for (const texture of subject.pictures) texture.dispose();
    forgetDepths();
    subject = {
      views: found,
      reach: views.reachOf(bitmaps),
      pictures: bitmaps.map((image) => {
        const texture = new THREE.Texture(image);
        texture.generateMipmaps = false;
        texture.minFilter = THREE.LinearFilter;
        texture.needsUpdate = true;
        return texture;
      }),
    };
    state.subject = id;
  }

  // ---- camera

  function aspectOf(panel) { return panel.width / panel.height; }

  function setCameraTo(panel) {
    const view = state.view === null ? null : subject.views[state.view];
    if (view) {
      shared.worldToView.value.copy(views.worldToView(view));
      shared.projection.value.copy(views.projection(view, aspectOf(panel), subject.reach));
    } else {
      camera.updateMatrixWorld();
      shared.worldToView.value.copy(camera.matrixWorldInverse);
      shared.projection.value.copy(views.freeProjection(views.lensOf(subject.views[0]), aspectOf(panel), subject.reach));
    }
  }

  function lookThrough(index) {
    const view = subject.views[index];
    const lens = views.lensOf(view);
    camera.fov = 2 * Math.atan(lens.half) * 180 / Math.PI;
    if (!view) {
      camera.position.set(0, 0, 3);
      controls.target.set(0, 0, 0);
      controls.update();
      state.view = null;
      return;
    }
    const toWorld = views.worldToView(view).invert();
    camera.position.setFromMatrixPosition(toWorld);
    const axis = new THREE.Vector3(0, 0, -1).transformDirection(toWorld);
    controls.target.copy(camera.position).addScaledVector(axis, Math.max(0.5, -camera.position.dot(axis)));
    controls.update();
    state.view = index; // after update(), which tells of a change
  }

  function turn(aroundDeg, upDeg, zoom) {
    leavePhoto();
    const arm = camera.position.clone().sub(controls.target);
    const up = Math.asin(arm.y / arm.length()), around = Math.atan2(arm.x, arm.z);
    const lifted = Math.max(-1.5, Math.min(1.5, up + upDeg * Math.PI / 180));
    const turned = around + aroundDeg * Math.PI / 180;
    const length = Math.max(controls.minDistance, Math.min(controls.maxDistance, arm.length() * zoom));
    arm.set(Math.cos(lifted) * Math.sin(turned), Math.sin(lifted), Math.cos(lifted) * Math.cos(turned));
    camera.position.copy(controls.target).addScaledVector(arm, length);
    controls.update();
    moved();
  }

  function moved() {
    isMoving = true;
    clearTimeout(resting);
    resting = setTimeout(() => { isMoving = false; request(); }, REST_MS);
    request();
  }

  const distance = () => camera.position.distanceTo(controls.target);

  function shownView() {
    if (!subject.views.length) return null;
    return state.view ?? views.nearest(subject.views, camera.position);
  }

  // ---- panels

  // Rectangles in CSS pixels from the top left, and the part of each that is drawn.
  function panels() {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (state.layout === "slider") {
      const at = Math.round(state.split * width);
      const whole = { x: 0, y: 0, width, height };
      return state.panels.slice(0, 2).map((name, index) => ({
        name, ...whole, clip: index ? { from: at, to: width } : { from: 0, to: at },
      }));
    }
    const columns = columnsFor(state.panels.length, width);
    const rows = Math.ceil(state.panels.length / columns) || 1;
    return state.panels.map((name, index) => {
      const x = (index % columns) * width / columns, y = Math.floor(index / columns) * height / rows;
      const panel = { name, x, y, width: width / columns, height: height / rows };
      return { ...panel, clip: { from: x, to: x + panel.width } };
    });
  }

  function columnsFor(count, width) {
    return Math.max(1, Math.min(count, Math.floor(width / 170) || 1, count > 4 && width < 900 ? 3 : count));
  }

  function stageColour() {
    if (isPrinting) return new THREE.Color(1, 1, 1);
    const [red, green, blue] = getComputedStyle(canvas.parentElement).backgroundColor.match(/[\d.]+/g);
    return new THREE.Color(red / 255, green / 255, blue / 255);
  }

  function draw() {
    if (isMoving && askedAt !== null && performance.now() - askedAt > SLOW_MS) isSlow = true;
    askedAt = null;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const size = renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) renderer.setSize(width, height, false);
    const shown = panels();
    if (state.shading === "photo") for (const panel of shown) depthOf(panel.name);
    renderer.setRenderTarget(null);
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, width, height);
    renderer.setClearColor(stageColour(), 1);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const panel of shown) {
      renderer.setViewport(panel.x, height - panel.y - panel.height, panel.width, panel.height);
      renderer.setScissor(panel.clip.from, height - panel.y - panel.height, panel.clip.to - panel.clip.from, panel.height);
      if (panel.name === "/photos") drawPhoto(panel, 1);
      else drawSurface(panel);
    }
    renderer.setScissorTest(false);
  }

  function drawSurface(panel) {
    const surface = formOf(panel.name);
    if (!surface) return;
    setCameraTo(panel);
    look.lit.value = state.light;
    look.limit.value = state.limit;
    look.mode.value = modeOf(surface);
    usePhoto(surface);
    show(surface, material);
    if (state.wires) show(surface, wire);
    if (state.view !== null && state.overlay > 0) drawPhoto(panel, state.overlay);
  }

  function modeOf(surface) {
    return state.shading === "error" && !surface.scalars[state.metric] ? 0 : shaders.MODES[state.shading];
  }

  function show(surface, how) {
    surface.geometry.setAttribute("scalar", surface.scalars[state.metric] ?? surface.none);
    body.geometry = surface.geometry;
    body.material = how;
    renderer.render(bodyScene, idle);
  }

  function drawPhoto(panel, opacity) {
    const index = shownView();
    if (index === null || !subject.pictures[index]) return;
    over.photo.value = subject.pictures[index];
    over.opacity.value = opacity;
    over.extent.value.set(...views.extentIn(subject.views[index], aspectOf(panel), subject.reach));
    renderer.render(pictureScene, idle);
  }

  // ---- photos on surfaces

  function usePhoto(surface) {
    const index = shownView();
    const depth = depths.get(surface);
    look.hasPhoto.value = state.shading === "photo" && index !== null && depth?.index === index;
    if (!look.hasPhoto.value) return;
    const view = subject.views[index];
    look.photo.value = subject.pictures[index];
    look.photoDepth.value = depth.target.depthTexture;
    look.photoFromWorld.value.multiplyMatrices(views.projection(view), views.worldToView(view));
  }

  // How far each pixel of the photo lies on a surface, so that no arm is painted on the trunk.
  function depthOf(name) {
    const index = shownView(), surface = formOf(name);
    if (index === null || !surface || depths.get(surface)?.index === index) return;
    const view = subject.views[index];
    const target = depths.get(surface)?.target ?? new THREE.WebGLRenderTarget(view.width, view.height, {
      depthTexture: new THREE.DepthTexture(view.width, view.height, THREE.UnsignedIntType),
    });
    look.hasPhoto.value = false;
    look.mode.value = 0;
    shared.worldToView.value.copy(views.worldToView(view));
    shared.projection.value.copy(views.projection(view));
    renderer.setRenderTarget(target);
    renderer.clear();
    show(surface, material);
    renderer.setRenderTarget(null);
    depths.set(surface, { index, target });
  }

  function forgetDepths() {
    for (const { target } of depths.values()) { target.depthTexture.dispose(); target.dispose(); }
    depths = new Map();
  }

  // ---- reading

  const spot = new THREE.WebGLRenderTarget(1, 1);

  // The value of the surface under a point of the canvas, in the metric's unit; null where none is.
  function valueAt(x, y) {
    const panel = panels().find((one) => x >= one.clip.from && x < one.clip.to && y >= one.y && y < one.y + one.height);
    const surface = panel && formOf(panel.name);
    if (!surface?.scalars[state.metric]) return null;
    setCameraTo(panel);
    // The one pixel becomes the whole picture.
    const nx = 2 * (x - panel.x) / panel.width - 1, ny = 1 - 2 * (y - panel.y) / panel.height;
    const pick = new THREE.Matrix4().set(
      panel.width, 0, 0, -nx * panel.width, 0, panel.height, 0, -ny * panel.height, 0, 0, 1, 0, 0, 0, 0, 1,
    );
    shared.projection.value.premultiply(pick);
    look.mode.value = shaders.MODES.probe;
    look.greatest.value = surface.greatest[state.metric];
    renderer.setRenderTarget(spot);
    renderer.setClearColor(0, 0);
    renderer.clear();
    show(surface, material);
    const pixel = new Uint8Array(4);
    renderer.readRenderTargetPixels(spot, 0, 0, 1, 1, pixel);
    renderer.setRenderTarget(null);
    const whole = pixel[0] * 256 + pixel[1];
    if (!pixel[2] || whole === 65535) return null;
    return { panel: panel.name, value: (whole / 65535) * surface.greatest[state.metric] };
  }

  // The colour on the screen, for the page's own tests.
  function pixelAt(x, y) {
    draw();
    const gl = renderer.getContext(), ratio = renderer.getPixelRatio();
    const pixel = new Uint8Array(4);
    gl.readPixels(Math.floor(x * ratio), Math.floor((canvas.clientHeight - y) * ratio) - 1, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return Array.from(pixel);
  }

  // Of full surfaces; those of coarse ones, where they stand for them, are in drawn().
  function triangles() {
    return Object.fromEntries(state.panels.map((name) => [name, surfaces.full.get(keyOf(name))?.faces ?? 0]));
  }

  function drawn() {
    return Object.fromEntries(state.panels.map((name) => [name, formOf(name)?.faces ?? 0]));
  }

  function request() {
    if (askedAt !== null) return;
    askedAt = performance.now();
    requestAnimationFrame(draw);
  }

  // A canvas is black until something is drawn.
  renderer.setClearColor(stageColour(), 1);
  renderer.clear();
  new ResizeObserver(request).observe(canvas);
  new MutationObserver(request).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", request);
  for (const [name, printing] of [["beforeprint", true], ["afterprint", false]]) {
    window.addEventListener(name, () => { isPrinting = printing; draw(); });
  }
  // Graphics that were reset, as after sleep or by another page, come back without their pictures.
  canvas.addEventListener("webglcontextrestored", () => { forgetDepths(); request(); });

  return {
    state, isSoftware, keep, has, setSubject, lookThrough, turn, shownView, panels, columnsFor, draw, request,
    valueAt, pixelAt, triangles, drawn, distance, forgetDepths,
  };
};
