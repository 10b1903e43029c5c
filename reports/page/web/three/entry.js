// What the page needs of three.js, in one file that a page opened from disk can load.
// Build it with: npm ci && npm run build   (in this folder)
export {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  DepthTexture,
  DoubleSide,
  GLSL3,
  LinearFilter,
  Matrix4,
  Mesh,
  NearestFilter,
  PerspectiveCamera,
  PlaneGeometry,
  RGBAFormat,
  RawShaderMaterial,
  Raycaster,
  Scene,
  ShaderMaterial,
  Texture,
  UnsignedIntType,
  Vector2,
  Vector3,
  WebGLRenderTarget,
  WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
