// Brings surfaces and photos of subjects from their files, each once, and measures how long it took.
"use strict";

HarnessPage.createLoader = (subjects) => {
  const timings = { scripts_ms: performance.now(), surfaces: {} };
  const coming = new Map();

  const fileOf = (surface, form) => (form === "coarse" ? surface.coarse : surface.file);

  // A surface on its way. It may be asked for before there is a view that takes it.
  function surface(subject, method, form) {
    const key = [subject.id, method, form].join("\n");
    if (!coming.has(key)) {
      const wanted = subject.surfaces.find((one) => one.method === method);
      coming.set(key, decoded(subject, wanted, form).catch((error) => { coming.delete(key); throw error; }));
    }
    return coming.get(key);
  }

  async function decoded(subject, { method, ...wanted }, form) {
    const words = form === "coarse" ? [subject.id, method, form] : [subject.id, method];
    const begin = performance.now();
    const received = await HarnessPage.load(words, fileOf(wanted, form));
    const loaded = performance.now();
    const made = await HarnessPage.decode(received);
    made.greatest = Object.fromEntries(received[0].scalars.map((scalar) => [scalar.id, scalar.step * 65534]));
    HarnessPage.forget(words); // the text is not needed any more
    timings.surfaces[words.join(" ")] = {
      faces: received[0].faces, load_ms: loaded - begin, decode_ms: performance.now() - loaded,
    };
    return made;
  }

  // The form that is drawn first: coarse where there is one.
  const firstForm = (wanted) => (wanted.coarse ? "coarse" : "full");

  function prefetch(id, methods) {
    const subject = subjects.find((one) => one.id === id);
    for (const one of subject?.surfaces ?? []) {
      if (methods.includes(one.method)) surface(subject, one.method, firstForm(one)).catch(() => {}); // said when it is shown
    }
  }

  function done(subject, method, form) {
    coming.delete([subject.id, method, form].join("\n"));
  }

  function forgetOthers(id) {
    for (const key of coming.keys()) if (!key.startsWith(`${id}\n`)) coming.delete(key);
  }

  async function photos(subject) {
    if (!subject.photos) return [];
    const texts = await HarnessPage.load([subject.id, "photos"], subject.photos);
    return Promise.all(texts.map(async (text) => {
      const image = new Image();
      image.src = text;
      await image.decode();
      return image;
    }));
  }

  return { timings, surface, firstForm, prefetch, done, forgetOthers, photos };
};
