// Cameras: those of photos, and the one that all panels share.
"use strict";

HarnessPage.views = (() => {
  const NEAR = 0.3, FAR = 30;
  const WIDEST = 0.94, HIGHEST = 0.85, DOWN = 0.055; // leaves room above for the heads of panels

  // OpenCV's camera axes (x right, y down, z forward) against WebGL's (y up, z backward).
  function worldToView(view) {
    const m = view.worldToCamera;
    return new THREE.Matrix4().set(
      m[0], m[1], m[2], m[3],
      -m[4], -m[5], -m[6], -m[7],
      -m[8], -m[9], -m[10], -m[11],
      0, 0, 0, 1,
    );
  }

  // Half sides of a photo in a panel of another shape, so large that the subject fills the panel.
  function extentIn(view, aspect, reach = [1, 1]) {
    const own = view.width / view.height;
    const [sx, sy] = aspect > own ? [own / aspect, 1] : [1, aspect / own];
    const zoom = Math.min(WIDEST / (sx * reach[0]), HIGHEST / (sy * reach[1]));
    return [zoom * sx, zoom * sy];
  }

  // How far the subject reaches from the middle of its photos, as shares of their half sides.
  function reachOf(pictures) {
    const size = 96, reach = [0.05, 0.05];
    const sheet = Object.assign(document.createElement("canvas"), { width: size, height: size });
    const pen = sheet.getContext("2d", { willReadFrequently: true });
    for (const picture of pictures) {
      pen.clearRect(0, 0, size, size);
      pen.drawImage(picture, 0, 0, size, size);
      const { data } = pen.getImageData(0, 0, size, size);
      for (let k = 0; k < size * size; k++) {
        if (data[4 * k + 3] < 128) continue;
        const x = Math.abs(2 * (k % size + 0.5) / size - 1), y = Math.abs(2 * (Math.floor(k / size) + 0.5) / size - 1);
        reach[0] = Math.max(reach[0], x + 1 / size);
        reach[1] = Math.max(reach[1], y + 1 / size);
      }
    }
    return pictures.length ? reach : [1, 1];
  }

  function projection(view, aspect, reach) {
    const [fx, fy, cx, cy] = view.intrinsics;
    const { width, height } = view;
    const [sx, sy] = aspect === undefined ? [1, 1] : extentIn(view, aspect, reach);
    const down = aspect === undefined ? 0 : DOWN;
    if (view.orthographic) {
      return new THREE.Matrix4().set(
        sx * 2 * fx / width, 0, 0, sx * (2 * cx / width - 1),
        0, sy * 2 * fy / height, 0, sy * (1 - 2 * cy / height) - down,
        0, 0, 2 / (NEAR - FAR), (NEAR + FAR) / (NEAR - FAR),
        0, 0, 0, 1,
      );
    }
    return new THREE.Matrix4().set(
      sx * 2 * fx / width, 0, sx * (1 - 2 * cx / width), 0,
      0, sy * 2 * fy / height, sy * (2 * cy / height - 1) + down, 0,
      0, 0, (NEAR + FAR) / (NEAR - FAR), 2 * NEAR * FAR / (NEAR - FAR),
      0, 0, -1, 0,
    );
  }

  // With the lens of the front photo, as large as it would be shown in a panel of this shape.
  function freeProjection(lens, aspect, reach) {
    const [sx, sy] = extentIn(lens, aspect, reach);
    return new THREE.Matrix4().set(
      sx / (lens.half * lens.width / lens.height), 0, 0, 0,
      0, sy / lens.half, DOWN, 0,
      0, 0, (NEAR + FAR) / (NEAR - FAR), 2 * NEAR * FAR / (NEAR - FAR),
      0, 0, -1, 0,
    );
  }

  function lensOf(view) {
    if (!view) return { half: 0.36, width: 9, height: 16 };
    const distance = view.orthographic ? positionOf(view).length() : 1;
    return { half: view.height / 2 / view.intrinsics[1] / distance, width: view.width, height: view.height };
  }

  function positionOf(view) {
    return new THREE.Vector3().setFromMatrixPosition(worldToView(view).invert());
  }

  // The photo whose camera sees the subject most like this position does.
  function nearest(views, position) {
    const direction = position.clone().normalize();
    let best = 0, most = -2;
    views.forEach((view, index) => {
      const alike = positionOf(view).normalize().dot(direction);
      if (alike > most) [best, most] = [index, alike];
    });
    return best;
  }

  return { DOWN, worldToView, projection, freeProjection, extentIn, lensOf, positionOf, nearest, reachOf };
})();
