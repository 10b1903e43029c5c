// Connects the viewer with the page: subjects, panels, shading, colour bar, keys, address.
"use strict";

(() => {
  const { data } = HarnessPage;
  const section = document.getElementById("surfaces");
  if (!section || !data) return;
  const find = (selector) => section.querySelector(selector);
  const canvas = find("canvas"), stage = find(".stage"), notice = find(".stage .notice"), probe = find(".probe");
  const heads = find(".panels"), strip = find(".photos"), divider = find(".divider");
  const PHOTO = "/photos";
  const loader = HarnessPage.createLoader(data.subjects);
  const { timings } = loader;

  const scalarOf = (id) => data.scalars.find((scalar) => scalar.id === id);
  const subjectOf = (id) => data.subjects.find((subject) => subject.id === id);

  const wanted = heard();
  loader.prefetch(wanted.subject, wanted.panels); // while graphics start

  let viewer;
  try {
    viewer = HarnessPage.createViewer(canvas, () => { markPhoto(); say(); });
  } catch {
    section.classList.add("flat");
    tell("This browser shows no 3-D graphics (WebGL 2). Photos and tables are complete without them.");
    HarnessPage.ready = showPhotosAlone();
    return;
  }
  timings.graphics_ms = performance.now();
  const { state } = viewer;
  const limits = Object.fromEntries(data.scalars.map((scalar) => [scalar.id, scalar.limit]));
  const current = () => subjectOf(state.subject);
  const surfaceOf = (name) => current().surfaces.find((surface) => surface.method === name);

  function tell(text) {
    notice.textContent = text;
    notice.hidden = !text;
  }

  // ---- content

  async function loadSurface(subject, name, form) {
    if (viewer.has(name, "full") || viewer.has(name, form)) return;
    viewer.keep(`${subject.id}\n${name}`, await loader.surface(subject, name, form), form);
    loader.done(subject, name, form);
  }

  async function showPhotosAlone() {
    const show = async (id) => strip.replaceChildren(...await loader.photos(subjectOf(id)));
    section.addEventListener("change", ({ target }) => { if (target.name === "subject") show(target.value); });
    find(`input[name=subject][value="${CSS.escape(wanted.subject)}"]`).checked = true;
    await show(wanted.subject);
  }

  let turnOfSubject = 0;
  async function setSubject(id) {
    const mine = ++turnOfSubject;
    const subject = subjectOf(id);
    loader.forgetOthers(id);
    loader.prefetch(id, wish);
    const pictures = await loader.photos(subject).catch((error) => { tell(error.message); return []; });
    if (mine !== turnOfSubject) return;
    timings.photos_ms ??= performance.now();
    const view = state.view, first = state.subject === null;
    viewer.setSubject(id, pictures.length ? subject.views : [], pictures);
    showChosen(find(`input[name=subject][value="${CSS.escape(id)}"]`));
    makeStrip(subject, pictures);
    if (first || view !== null) viewer.lookThrough(view ?? 0);
    markPhoto();
    await showPanels();
  }

  // What was asked for, as far as this subject has it: another one may have the rest again.
  let wish = wanted.panels;
  function setPanels(names) {
    wish = names;
    return showPanels();
  }

  function showChosen(input) {
    input.checked = true;
    const row = find(".subjects"), { offsetLeft, offsetWidth } = input.parentElement;
    const isOutside = offsetLeft < row.scrollLeft || offsetLeft + offsetWidth > row.scrollLeft + row.clientWidth;
    if (isOutside) row.scrollLeft = offsetLeft - (row.clientWidth - offsetWidth) / 2;
  }

  const isThere = (name) => (name === PHOTO ? current().views.length > 0 : Boolean(surfaceOf(name)));

  async function showPanels() {
    const names = wish.filter(isThere);
    state.panels = names.length ? names : [data.truth];
    viewer.forgetDepths();
    makeHeads();
    layOut();
    const subject = current(), isHere = () => state.subject === subject.id;
    stage.setAttribute("aria-busy", "true");
    tell("");
    await bring(subject, (surface) => loader.firstForm(surface));
    if (!isHere()) return;
    viewer.draw();
    timings.first_ms ??= performance.now();
    timings.first_faces ??= viewer.drawn();
    shown();
    await painted();
    await bring(subject, () => "full");
    if (!isHere()) return;
    viewer.request();
    stage.removeAttribute("aria-busy");
    timings.loaded_ms ??= performance.now();
    say();
  }

  // Load what the panels show, in the form that is wanted of each surface.
  async function bring(subject, formOf) {
    const surfaces = subject.surfaces.filter(({ method }) => state.panels.includes(method));
    await Promise.all(surfaces.map(async (surface) => {
      try {
        await loadSurface(subject, surface.method, formOf(surface));
      } catch (error) {
        tell(error.message);
      }
      // Software draws so slowly that it had better draw all of them once.
      if (state.subject === subject.id && !viewer.isSoftware) viewer.request();
    }));
  }

  // The browser shows what was drawn, unless it shows nothing now, as in a window behind others.
  const painted = () => new Promise((done) => { requestAnimationFrame(() => setTimeout(done)); setTimeout(done, 150); });

  // ---- heads of panels

  function choices(selected) {
    const names = [...current().surfaces.map((surface) => [surface.method, surface.title])];
    if (current().views.length) names.unshift([PHOTO, "Photo"]);
    return names.map(([name, title]) => new Option(title, name, false, name === selected));
  }

  function makeHeads() {
    heads.replaceChildren(...state.panels.map((name, index) => {
      const head = document.createElement("div");
      head.className = "head";
      const select = document.createElement("select");
      select.setAttribute("aria-label", `Surface ${index + 1}`);
      select.append(...choices(name));
      select.addEventListener("change", () => {
        const names = [...state.panels];
        names[index] = select.value;
        setPanels(names).then(() => heads.querySelectorAll("select")[index]?.focus());
      });
      const value = document.createElement("span");
      value.className = "figure";
      value.textContent = figureOf(name);
      head.append(select, value);
      if (state.panels.length > 1 && state.layout === "side") head.append(button("×", "Remove this surface", () => setPanels(state.panels.filter((_, at) => at !== index))));
      return head;
    }));
    if (state.layout === "side" && state.panels.length < 6) {
      const more = button("+", "Add a surface", () => setPanels([...state.panels, nextName()]));
      more.className = "more";
      heads.append(more);
    }
  }

  function nextName() {
    const free = current().surfaces.find((surface) => !state.panels.includes(surface.method));
    return free ? free.method : data.truth;
  }

  function button(text, label, action) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.setAttribute("aria-label", label);
    made.title = label;
    made.addEventListener("click", action);
    return made;
  }

  // What the tables say of this surface, in the unit of the colours.
  function figureOf(name) {
    const values = surfaceOf(name)?.values ?? {};
    const metric = state.metric === "normal_error" ? "normal_error" : "chamfer";
    const unit = metric === "normal_error" ? "°" : " mm";
    return metric in values ? `${metric === "chamfer" ? "Chamfer " : "Normal "}${values[metric].toFixed(1)}${unit}` : "";
  }

  // ---- layout

  function layOut() {
    const isSlider = state.layout === "slider";
    if (isSlider && state.panels.length < 2) state.panels = [...state.panels, nextName()];
    const columns = isSlider ? 2 : viewer.columnsFor(state.panels.length, stage.clientWidth);
    const rows = isSlider ? 1 : Math.ceil(state.panels.length / columns);
    section.style.setProperty("--columns", columns);
    section.style.setProperty("--rows", rows);
    section.classList.toggle("slider", isSlider);
    divider.hidden = !isSlider;
    find("label[for=split]").hidden = !isSlider;
    placeHeads(columns);
    placeDivider();
    viewer.request();
  }

  function placeHeads(columns) {
    [...heads.querySelectorAll(".head")].forEach((head, index) => {
      head.hidden = state.layout === "slider" && index > 1;
      head.style.gridColumn = (index % columns) + 1;
      head.style.gridRow = Math.floor(index / columns) + 1;
    });
  }

  function placeDivider() {
    divider.style.left = `${100 * state.split}%`;
    find("#split").value = 100 * state.split;
  }

  // ---- photos

  function makeStrip(subject, pictures) {
    strip.replaceChildren(...pictures.map((image, index) => {
      const degrees = Math.round(subject.views[index].yaw);
      const made = button("", `Photo ${index}, camera ${degrees}° from the front`, () => look(index));
      made.append(image, Object.assign(document.createElement("span"), { textContent: `${degrees}°` }));
      image.alt = "";
      return made;
    }));
    markPhoto();
  }

  function look(index) {
    viewer.lookThrough(index);
    markPhoto();
    viewer.request();
    say();
  }

  function markPhoto() {
    [...strip.children].forEach((one, index) => one.setAttribute("aria-pressed", String(index === state.view)));
    find("#overlay").disabled = state.view === null;
  }

  // ---- colour bar

  // The slider is finer for small limits.
  const toLimit = (place, scalar) => scalar.greatest ** (place / 1000) * (scalar.greatest / 100) ** (1 - place / 1000);
  const toPlace = (limit, scalar) => 1000 * Math.log(limit * 100 / scalar.greatest) / Math.log(100);

  function setMetric(id) {
    state.metric = id;
    find("#metric").value = id;
    setLimit(limits[id]);
    heads.querySelectorAll(".figure").forEach((figure, index) => { figure.textContent = figureOf(state.panels[index]); });
  }

  function setLimit(limit) {
    const scalar = scalarOf(state.metric);
    state.limit = limits[state.metric] = limit;
    const input = find("#limit"), shown = (value) => `${Number(value.toPrecision(value < limit ? 2 : 3))}`;
    input.value = toPlace(limit, scalar);
    input.setAttribute("aria-valuetext", `${shown(limit)} ${scalar.unit}`);
    find(".ticks").replaceChildren(...[0, 0.5, 1].map((share) => Object.assign(
      document.createElement("span"),
      { textContent: share === 1 ? `≥ ${shown(limit)} ${unitSign(scalar)}` : shown(share * limit) },
    )));
    viewer.request();
  }

  const unitSign = (scalar) => (scalar.unit === "deg" ? "°" : scalar.unit);

  // ---- address: what is shown can be shared

  function say() {
    const parts = new URLSearchParams({
      subject: state.subject, show: state.panels.join(" "), shading: state.shading, metric: state.metric,
      limit: Number(state.limit.toPrecision(4)), layout: state.layout,
    });
    if (state.view !== null) parts.set("camera", state.view);
    if (!state.light) parts.set("light", "no");
    if (state.wires) parts.set("wires", "yes");
    try { history.replaceState(null, "", `#${parts}`); } catch { /* some readers refuse it for files */ }
  }

  function heard() {
    const parts = new URLSearchParams(location.hash.slice(1));
    const known = new Set([PHOTO, data.truth, ...data.subjects.flatMap((one) => one.surfaces.map((surface) => surface.method))]);
    const names = (parts.get("show") ?? "").split(" ").filter((name) => known.has(name));
    return {
      subject: subjectOf(parts.get("subject"))?.id ?? data.subjects.find((one) => one.surfaces.length)?.id,
      panels: names.length ? names : opening(), parts,
    };
  }

  function opening() {
    const photo = data.subjects.some((subject) => subject.views.length) ? [PHOTO] : [];
    const narrow = stage.clientWidth < 640;
    return [...photo, ...data.opening].slice(0, narrow ? 2 : 6).concat(narrow ? [] : [data.truth]);
  }

  // ---- events

  function listen() {
    section.addEventListener("change", ({ target }) => {
      if (target.name === "subject") setSubject(target.value);
      if (target.name === "shading") set({ shading: target.value });
      if (target.name === "layout") { state.layout = target.value; setPanels(state.panels.length > 1 ? state.panels : [...state.panels, nextName()]); }
      if (target.id === "metric") setMetric(target.value);
      if (target.id === "light") set({ light: target.checked });
      if (target.id === "wires") set({ wires: target.checked });
      say();
    });
    section.addEventListener("input", ({ target }) => {
      if (target.id === "limit") setLimit(toLimit(Number(target.value), scalarOf(state.metric)));
      if (target.id === "overlay") set({ overlay: target.value / 100 });
      if (target.id === "split") { set({ split: target.value / 100 }); placeDivider(); }
    });
    find("#front").addEventListener("click", () => look(0));
    canvas.addEventListener("keydown", onKey);
    canvas.addEventListener("pointermove", (event) => { if (!event.buttons) probeAt(event); });
    canvas.addEventListener("pointerleave", () => { probe.hidden = true; });
    dragDivider();
    new ResizeObserver(layOut).observe(stage);
  }

  function set(values) {
    Object.assign(state, values);
    section.dataset.shading = state.shading;
    viewer.request();
  }

  const TURNS = {
    ArrowLeft: [-10, 0, 1], ArrowRight: [10, 0, 1], ArrowUp: [0, 10, 1], ArrowDown: [0, -10, 1],
    "+": [0, 0, 0.85], "=": [0, 0, 0.85], "-": [0, 0, 1.18],
  };

  function onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (TURNS[event.key]) viewer.turn(...TURNS[event.key]);
    else if (event.key === "0") look(0);
    else if (/^[1-9]$/.test(event.key) && event.key <= current().views.length) look(event.key - 1);
    else return;
    event.preventDefault();
    say();
  }

  let probing = 0;
  function probeAt(event) {
    clearTimeout(probing);
    const { offsetX: x, offsetY: y } = event;
    probing = setTimeout(() => {
      const found = viewer.valueAt(x, y);
      const scalar = scalarOf(state.metric);
      probe.hidden = !found;
      if (!found) return;
      probe.textContent = `${found.value.toFixed(1)} ${unitSign(scalar)}`;
      probe.style.translate = `${x + 14}px ${y - 10}px`;
    }, 30);
  }

  function dragDivider() {
    const move = (event) => {
      const box = stage.getBoundingClientRect();
      set({ split: Math.min(0.98, Math.max(0.02, (event.clientX - box.left) / box.width)) });
      placeDivider();
    };
    divider.addEventListener("pointerdown", (event) => {
      divider.setPointerCapture(event.pointerId);
      divider.addEventListener("pointermove", move);
      event.preventDefault();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      divider.addEventListener(end, () => divider.removeEventListener("pointermove", move));
    }
  }

  function start() {
    const { parts } = wanted;
    find(".ramp").style.background = `linear-gradient(to right, ${HarnessPage.shaders.RAMP.join(", ")})`;
    for (const [name, values] of [["shading", Object.keys(HarnessPage.shaders.MODES)], ["layout", ["side", "slider"]]]) {
      const choice = parts.get(name);
      const input = values.includes(choice) && find(`input[name=${name}][value=${choice}]`);
      if (input) { input.checked = true; state[name] = choice; }
    }
    section.dataset.shading = state.shading;
    state.light = find("#light").checked = parts.get("light") !== "no";
    state.wires = find("#wires").checked = parts.get("wires") === "yes";
    state.panels = wanted.panels;
    setMetricEarly(parts);
    listen();
    const camera = Number(parts.get("camera") ?? 0);
    const views = subjectOf(wanted.subject).views.length;
    if (camera > 0 && camera < views) state.view = camera;
    return setSubject(wanted.subject);
  }

  function setMetricEarly(parts) {
    const scalar = scalarOf(parts.get("metric")) ?? data.scalars[0];
    if (!scalar) return;
    const limit = Number(parts.get("limit"));
    if (limit > 0 && limit <= scalar.greatest) limits[scalar.id] = limit;
    state.metric = scalar.id;
    find("#metric").value = scalar.id;
    setLimit(limits[scalar.id]);
  }

  let shown;
  HarnessPage.firstView = new Promise((resolve) => { shown = resolve; });
  HarnessPage.viewer = viewer;
  HarnessPage.timings = timings;
  HarnessPage.ready = start();
})();
