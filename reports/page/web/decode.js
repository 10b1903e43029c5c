// The compact form of meshes, decoded: reports/page/compact_mesh.py describes it.
"use strict";

HarnessPage.decode = (() => {
  // Large meshes are decoded beside the page, so that it can be used meanwhile.
  const LARGE_FACES = 60000, MOST_WORKERS = 4;

  // Self-contained: workers get its text, since a page from disk may load no worker from a file.
  function makeDecoder() {
    const NONE = 65535;

    function bytesOf(text) {
      if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
      const binary = atob(text);
      const bytes = new Uint8Array(binary.length);
      for (let k = 0; k < bytes.length; k++) bytes[k] = binary.charCodeAt(k);
      return bytes;
    }

    async function unpacked(text) {
      const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
      return new Uint8Array(await new Response(stream).arrayBuffer());
    }

    function positions(data, header) {
      const count = header.vertices;
      const out = new Float32Array(3 * count);
      for (let axis = 0; axis < 3; axis++) {
        const low = 2 * count * axis;
        let sum = 0;
        for (let k = 0; k < count; k++) {
          const folded = data[low + k] | (data[low + count + k] << 8);
          sum = (sum + (folded & 1 ? -(folded + 1) / 2 : folded / 2)) & 0xffff;
          out[3 * k + axis] = header.low[axis] + sum * header.step;
        }
      }
      return out;
    }

    function corners(data, header) {
      const count = 3 * header.faces;
      const base = 6 * header.vertices;
      const out = new Uint32Array(count);
      let next = 0;
      for (let k = 0; k < count; k++) {
        const code =
          data[base + k] |
          (data[base + count + k] << 8) |
          (data[base + 2 * count + k] << 16) |
          (data[base + 3 * count + k] << 24);
        out[k] = next - code;
        if (code === 0) next++;
      }
      return out;
    }

    // Values in their unit; -1 where a vertex has none, which the shader shows in grey.
    function scalar(data, header, index) {
      const count = header.vertices;
      const base = 6 * count + 12 * header.faces + 2 * count * index;
      const step = header.scalars[index].step;
      const out = new Float32Array(count);
      for (let k = 0; k < count; k++) {
        const stored = data[base + k] | (data[base + count + k] << 8);
        out[k] = stored === NONE ? -1 : stored * step;
      }
      return out;
    }

    // Weighted by area; the shader normalises.
    function normals(points, indices) {
      const out = new Float32Array(points.length);
      for (let k = 0; k < indices.length; k += 3) {
        const a = 3 * indices[k], b = 3 * indices[k + 1], c = 3 * indices[k + 2];
        const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
        const wx = points[c] - points[a], wy = points[c + 1] - points[a + 1], wz = points[c + 2] - points[a + 2];
        const x = 1e4 * (uy * wz - uz * wy), y = 1e4 * (uz * wx - ux * wz), z = 1e4 * (ux * wy - uy * wx);
        out[a] += x; out[a + 1] += y; out[a + 2] += z;
        out[b] += x; out[b + 1] += y; out[b + 2] += z;
        out[c] += x; out[c + 1] += y; out[c + 2] += z;
      }
      return out;
    }

    return async ([header, payload]) => {
      const data = await unpacked(payload);
      const points = positions(data, header);
      const indices = corners(data, header);
      const scalars = {};
      header.scalars.forEach(({ id }, index) => { scalars[id] = scalar(data, header, index); });
      return { points, indices, normals: normals(points, indices), scalars };
    };
  }

  const decodeHere = makeDecoder();
  const waiting = new Map();
  let workers = null, asked = 0;

  const inWorker = (makeDecoder) => {
    const decode = makeDecoder();
    onmessage = async ({ data: [number, received] }) => {
      try {
        const made = await decode(received);
        const arrays = [made.points, made.indices, made.normals, ...Object.values(made.scalars)];
        postMessage([number, made], arrays.map((array) => array.buffer));
      } catch (error) {
        postMessage([number, null, error.message]);
      }
    };
  };

  function started() {
    const source = `"use strict"; (${inWorker})(${makeDecoder});`;
    const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
    const count = Math.max(1, Math.min(MOST_WORKERS, navigator.hardwareConcurrency || 1));
    return Array.from({ length: count }, () => {
      const worker = new Worker(address);
      worker.onmessage = ({ data: [number, made, complaint] }) => {
        const { resolve, reject } = waiting.get(number);
        waiting.delete(number);
        if (made) resolve(made);
        else reject(new Error(`a surface is damaged: ${complaint}`));
      };
      worker.onerror = (event) => {
        // A browser that allows no such workers says so here: all that they were given is done here.
        event.preventDefault();
        for (const one of workers) one.terminate();
        workers = [];
        for (const { received, resolve, reject } of waiting.values()) decodeHere(received).then(resolve, reject);
        waiting.clear();
      };
      return worker;
    });
  }

  function decodeBeside(received) {
    try {
      workers ??= started();
    } catch {
      workers = [];
    }
    if (!workers.length) return decodeHere(received);
    return new Promise((resolve, reject) => {
      const number = asked++;
      waiting.set(number, { received, resolve, reject });
      workers[number % workers.length].postMessage([number, received]);
    });
  }

  return (received) => (received[0].faces < LARGE_FACES ? decodeHere : decodeBeside)(received);
})();
