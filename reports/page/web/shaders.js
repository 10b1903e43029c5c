// One material for every shading, so that switching costs nothing.
"use strict";

HarnessPage.shaders = (() => {
  // From a light neutral, which is close to the truth, to dark red.
  const RAMP = [
    "#e9e5dc", "#f0dca8", "#f6cf7c", "#f6b35b", "#ee9150", "#e06c4a", "#c94b48", "#a53047",
    "#7d1f40", "#561735", "#341126",
  ];
  const WORK = { clay: 0, error: 1, normals: 2, photo: 3, probe: 4, truth: 0 };

  // Centroid: triangles smaller than a pixel would be read beyond their edges.
  const vertex = /* glsl */ `
    in vec3 position;
    in vec3 normal;
    in float scalar;
    uniform mat4 projection;
    uniform mat4 worldToView;
    uniform mat4 photoFromWorld;
    centroid out vec3 vNormal;
    centroid out vec3 vView;
    centroid out vec4 vPhoto;
    centroid out float vScalar;
    void main() {
      vec4 view = worldToView * vec4(position, 1.0);
      vView = view.xyz;
      vNormal = mat3(worldToView) * normal;
      vScalar = scalar;
      vPhoto = photoFromWorld * vec4(position, 1.0);
      gl_Position = projection * view;
    }`;

  const fragment = /* glsl */ `
    precision highp float;
    centroid in vec3 vNormal;
    centroid in vec3 vView;
    centroid in vec4 vPhoto;
    centroid in float vScalar;
    uniform int mode;
    uniform bool lit;
    uniform bool hasPhoto;
    uniform float limit;
    uniform float greatest;
    uniform sampler2D ramp;
    uniform sampler2D photo;
    uniform sampler2D photoDepth;
    out vec4 colour;

    const vec3 LIGHT = vec3(-0.33, 0.42, 0.845);

    void main() {
      vec3 normal = normalize(vNormal);
      vec3 toEye = normalize(-vView);
      // By the smooth normal: slivers that face away would speckle a surface seen from outside.
      float facing = dot(normal, toEye);
      bool inside = facing < -0.2;
      if (inside) normal = -normal;
      else if (facing < 0.0) normal = normalize(normal - 1.02 * facing * toEye);
      if (mode == 4) {
        // The value in 16 bits; blue says that a surface is there.
        float share = vScalar < -0.5 ? 1.0 : min(vScalar / greatest, 0.9999);
        float whole = floor(share * 65535.0 + 0.5);
        colour = vec4(floor(whole / 256.0) / 255.0, mod(whole, 256.0) / 255.0, 1.0, 1.0);
        return;
      }
      float key = max(dot(normal, LIGHT), 0.0);
      float fill = 0.5 + 0.5 * normal.y;
      float light = lit ? 0.30 + 0.58 * key + 0.14 * fill : 1.0;
      vec3 clay = inside ? vec3(0.52, 0.55, 0.62) : vec3(0.83, 0.82, 0.80);
      vec3 base = clay;
      if (mode == 1) {
        base = vScalar < -0.5 ? vec3(0.6) : texture(ramp, vec2(vScalar / limit, 0.5)).rgb;
        light = lit ? 0.60 + 0.34 * key + 0.10 * fill : 1.0;
      } else if (mode == 2) {
        base = 0.5 + 0.5 * normal;
        light = 1.0;
      } else if (mode == 3 && hasPhoto) {
        vec3 at = vPhoto.xyz / vPhoto.w;
        vec2 place = 0.5 + 0.5 * at.xy;
        bool shown = vPhoto.w > 0.0 && all(greaterThan(place, vec2(0.0))) && all(lessThan(place, vec2(1.0)));
        float nearest = texture(photoDepth, place).r;
        vec4 seen = texture(photo, place);
        if (shown && 0.5 + 0.5 * at.z < nearest + 0.0012 && seen.a > 0.5) {
          base = seen.rgb;
          light = lit ? 0.96 : 1.0;
        } else {
          base = mix(clay, vec3(0.5), 0.25);
        }
      }
      colour = vec4(min(base * light, 1.0), 1.0);
    }`;

  const pictureVertex = /* glsl */ `
    in vec3 position;
    in vec2 uv;
    uniform vec2 extent;
    uniform float down;
    out vec2 vUv;
    void main() {
      vUv = uv;
      gl_Position = vec4(2.0 * position.xy * extent - vec2(0.0, down), 0.0, 1.0);
    }`;

  const pictureFragment = /* glsl */ `
    precision highp float;
    in vec2 vUv;
    uniform sampler2D photo;
    uniform float opacity;
    out vec4 colour;
    void main() {
      vec4 seen = texture(photo, vUv);
      colour = vec4(seen.rgb, seen.a * opacity);
    }`;

  function rampBytes() {
    const size = 256, bytes = new Uint8Array(4 * size);
    const stops = RAMP.map((hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
    for (let k = 0; k < size; k++) {
      const place = (k / (size - 1)) * (stops.length - 1);
      const left = Math.min(Math.floor(place), stops.length - 2);
      for (let channel = 0; channel < 3; channel++) {
        const [from, to] = [stops[left][channel], stops[left + 1][channel]];
        bytes[4 * k + channel] = Math.round(from + (place - left) * (to - from));
      }
      bytes[4 * k + 3] = 255;
    }
    return bytes;
  }

  function rampTexture() {
    const texture = new THREE.DataTexture(rampBytes(), 256, 1, THREE.RGBAFormat);
    texture.magFilter = texture.minFilter = THREE.LinearFilter;
    texture.needsUpdate = true;
    return texture;
  }

  function surfaceMaterial(uniforms) {
    return new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      vertexShader: vertex,
      fragmentShader: fragment,
      side: THREE.DoubleSide,
      uniforms,
    });
  }

  function wireMaterial(uniforms) {
    return new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      wireframe: true,
      transparent: true,
      depthWrite: false,
      vertexShader: /* glsl */ `
        in vec3 position;
        uniform mat4 projection;
        uniform mat4 worldToView;
        void main() {
          gl_Position = projection * (worldToView * vec4(position, 1.0));
          gl_Position.z -= 0.0006 * gl_Position.w;
        }`,
      fragmentShader: /* glsl */ `
        precision highp float;
        out vec4 colour;
        void main() { colour = vec4(0.08, 0.09, 0.12, 0.42); }`,
      uniforms,
    });
  }

  function pictureMaterial(uniforms) {
    return new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      vertexShader: pictureVertex,
      fragmentShader: pictureFragment,
      transparent: true,
      depthTest: false,
      depthWrite: false,
      uniforms,
    });
  }

  return { RAMP, MODES: WORK, rampTexture, surfaceMaterial, wireMaterial, pictureMaterial };
})();
