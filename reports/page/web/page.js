// The page's one global: what scripts hand in, and how more of them are asked for.
"use strict";

const HarnessPage = (() => {
  const waiting = new Map();
  const loaded = new Map();

  // A page from disk may not fetch, but it may load scripts: each hands its content to receive(),
  // with the words that name it, such as a subject and a method.
  function load(words, file) {
    const key = words.join("\n");
    if (!loaded.has(key)) {
      loaded.set(key, new Promise((resolve, reject) => {
        const script = document.createElement("script");
        waiting.set(key, resolve);
        script.src = file;
        script.onload = () => script.remove();
        script.onerror = () => {
          loaded.delete(key);
          reject(new Error(`${decodeURIComponent(file)} is not there: copy the whole folder`));
        };
        document.head.append(script);
      }));
    }
    return loaded.get(key);
  }

  function receive(words, ...content) {
    const key = words.join("\n");
    waiting.get(key)?.(content.length === 1 ? content[0] : content);
    waiting.delete(key);
  }

  function forget(words) {
    loaded.delete(words.join("\n"));
  }

  return { data: null, load, receive, forget };
})();
