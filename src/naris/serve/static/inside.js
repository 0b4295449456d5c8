// What the scope sees: the wall drawn with the look of naris, exposed and developed as its sensor does.

import * as THREE from "./vendor/three.module.min.js";
import { BEND_FRAGMENT, COPY_FRAGMENT, DEVELOP_FRAGMENT, SCREEN_VERTEX, WALL_FRAGMENT, WALL_VERTEX } from "./shaders.js";

const METER_PX = 48;
const LUMINANCE = [0.3, 0.59, 0.11];
const NEAR_MM = 0.03, FAR_MM = 500;
const LEAST_ASPECT = 4 / 3; // of a picture whose corner a lens is told by

/** A surface for both views: corners, normals out of the closed surface, the number of each corner's region. */
export function geometryOf({ arrays }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(arrays.vertices, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(arrays.normals, 3));
  geometry.setAttribute("region", new THREE.BufferAttribute(Float32Array.from(arrays.region), 1));
  geometry.setIndex(new THREE.BufferAttribute(arrays.faces, 1));
  geometry.computeBoundingSphere();
  return geometry;
}

/** 256 colours, by the number of a region; grey for places in none. */
export function paletteOf(about) {
  const data = new Uint8Array(4 * 256).fill(150);
  about.regions.forEach(({ colour }, k) => {
    for (let c = 0; c < 3; c++) data[4 * k + c] = parseInt(colour.slice(1 + 2 * c, 3 + 2 * c), 16);
  });
  for (let k = 0; k < 256; k++) data[4 * k + 3] = 255;
  return texture(data, 256, 1, THREE.RGBAFormat, THREE.UnsignedByteType, THREE.NearestFilter);
}

export class Inside {
  constructor(canvas, geometry, palette, look) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.renderer.autoClear = false;
    this.camera = new THREE.PerspectiveCamera(45, 1, NEAR_MM, FAR_MM);
    this.camera.matrixAutoUpdate = false;
    this.look = look.about;
    this.exposure = 1; // of the person, beside the automatic one
    const about = look.about;
    this.wall = new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      vertexShader: WALL_VERTEX,
      fragmentShader: WALL_FRAGMENT,
      side: THREE.DoubleSide,
      uniforms: wallUniforms(about, look.arrays, palette),
    });
    this.scene = new THREE.Scene();
    this.mesh = new THREE.Mesh(geometry, this.wall);
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
    this.light = new THREE.WebGLRenderTarget(2, 2, {
      type: THREE.HalfFloatType, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
    });
    this.wide = new THREE.WebGLRenderTarget(2, 2, {
      type: THREE.HalfFloatType, minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter,
    });
    this.barrel = 0;
    this.meter = new THREE.WebGLRenderTarget(METER_PX, METER_PX, {
      type: THREE.FloatType, depthBuffer: false, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
    });
    this.read = new Float32Array(4 * METER_PX * METER_PX);
    const tone = texture(look.arrays.tone, 1024, 1, THREE.RedFormat, THREE.FloatType, THREE.NearestFilter);
    this.develop = screenMaterial(DEVELOP_FRAGMENT, {
      light: { value: this.light.texture },
      tone: { value: tone },
      gain: { value: new THREE.Vector3(1, 1, 1) },
      toneReach: { value: about.toneReach },
    });
    this.bend = screenMaterial(BEND_FRAGMENT, {
      light: { value: this.wide.texture }, reach: { value: new THREE.Vector2() }, edge: { value: new THREE.Vector2() },
      k1: { value: 0 }, vignette: { value: about.vignette },
    });
    this.copy = screenMaterial(COPY_FRAGMENT, { light: { value: this.light.texture } });
    const flat = new THREE.BufferGeometry();
    flat.setAttribute("position", new THREE.BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    this.screen = new THREE.Mesh(flat, this.develop);
    this.screen.frustumCulled = false;
    this.flatScene = new THREE.Scene();
    this.flatScene.add(this.screen);
    this.flatCamera = new THREE.Camera();
  }

  resize(width, height, ratio = 1) {
    this.renderer.setPixelRatio(1);
    const [w, h] = [width, height].map((n) => Math.max(Math.round(n * ratio), 2));
    this.renderer.setSize(w, h, false);
    this.light.setSize(w, h);
    this.size = [w, h];
  }

  /** Draws what a camera at a pose sees. */
  draw(pose, fovDeg) {
    const [w, h] = this.size;
    const u = this.wall.uniforms, about = this.look;
    const lens = this.barrel > 0 ? lensOf(this.barrel, fovDeg, w / h) : null;
    if (lens) this.wide.setSize(Math.ceil(w * lens.wider), Math.ceil(h * lens.wider));
    this.camera.fov = lens ? (360 / Math.PI) * Math.atan(lens.edge[1]) : fovDeg;
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    setCamera(this.camera, pose);
    const at = (x, y, z) => new THREE.Vector3(...[0, 1, 2].map((i) =>
      pose[i][0] * x + pose[i][1] * y + pose[i][2] * z + pose[i][3]));
    u.eye.value.copy(at(0, 0, 0));
    u.lamp.value.copy(at(about.light_x, about.light_y, about.light_z));
    u.axis.value.set(pose[0][2], pose[1][2], pose[2][2]);
    u.size.value.set(w, h);
    u.perPixel.value = (2 * (lens ? lens.reach[1] : Math.tan((fovDeg * Math.PI) / 360))) / h;
    u.vignette.value = lens ? 0 : about.vignette;
    this.renderer.setRenderTarget(lens ? this.wide : this.light);
    this.renderer.setClearColor(0x000000, 1);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    if (lens) {
      const bend = this.bend.uniforms;
      bend.k1.value = lens.k1;
      bend.reach.value.set(...lens.reach);
      bend.edge.value.set(...lens.edge);
      this.#pass(this.bend, this.light);
    }
    const gain = this.#gain();
    this.develop.uniforms.gain.value.set(about.balance_r, about.balance_g, about.balance_b).multiplyScalar(gain);
    this.#pass(this.develop, null);
  }

  /** How strongly walls are coloured by their region, 0 to 1. */
  set tint(value) {
    this.wall.uniforms.tint.value = value;
  }

  set brightness(value) {
    this.exposure = value;
  }

  #pass(material, target) {
    this.screen.material = material;
    this.renderer.setRenderTarget(target);
    this.renderer.render(this.flatScene, this.flatCamera);
  }

  /** Exposure as the sensor's: the brightest but some of the picture shall have a certain light. */
  #gain() {
    const about = this.look;
    if (about.auto <= 0) return about.gain * this.exposure;
    this.#pass(this.copy, this.meter);
    this.renderer.readRenderTargetPixels(this.meter, 0, 0, METER_PX, METER_PX, this.read);
    const values = new Float32Array(METER_PX * METER_PX);
    for (let i = 0; i < values.length; i++) {
      values[i] = LUMINANCE[0] * this.read[4 * i] + LUMINANCE[1] * this.read[4 * i + 1] + LUMINANCE[2] * this.read[4 * i + 2];
    }
    values.sort();
    const level = values[Math.min(Math.floor(about.quantile * values.length), values.length - 1)];
    const automatic = Math.min(Math.max(about.target / Math.max(level, 1e-9), about.gain_low), about.gain_high);
    return about.gain * automatic ** about.auto * this.exposure;
  }
}

/**
 * A lens that bends by `barrel` (k1 times the square of the way to the corner, below 4/27) and sees `fovDeg` upwards.
 *
 * The corner is that of a picture of 4:3 where this one is narrower: one lens serves this one and those beside it.
 * `reach` are the tangents of half the picture as the lens bends them, `edge` those without it at the corner, and a
 * picture that is bent must be `wider` by their ratio.
 */
export function lensOf(barrel, fovDeg, aspect) {
  const up = Math.tan((fovDeg * Math.PI) / 360), corner = 1 + Math.max(aspect, LEAST_ASPECT) ** 2;
  let share = 0; // k1 · up²
  for (let i = 0; i < 60; i++) share = -barrel / (corner * (1 + share) ** 2);
  const k1 = share / (up * up), high = up * (1 + share), to = high * Math.hypot(1, aspect);
  const wider = straightened(to, k1) / to;
  return { k1, reach: [high * aspect, high], edge: [high * aspect * wider, high * wider], wider };
}

/** The way from the axis that a lens bends to `to`. */
export function straightened(to, k1) {
  let r = to;
  for (let i = 0; i < 12; i++) r -= (r * (1 + k1 * r * r) - to) / (1 + 3 * k1 * r * r);
  return r;
}

/** Puts a camera of three.js (y up, looking along −z) where a pose of ours (y down, along +z) is. */
export function setCamera(camera, pose) {
  camera.matrix.set(
    pose[0][0], -pose[0][1], -pose[0][2], pose[0][3],
    pose[1][0], -pose[1][1], -pose[1][2], pose[1][3],
    pose[2][0], -pose[2][1], -pose[2][2], pose[2][3],
    0, 0, 0, 1,
  );
  camera.matrixWorldNeedsUpdate = true;
  camera.updateMatrixWorld(true);
}

function wallUniforms(about, arrays, palette) {
  const value = (v) => ({ value: v });
  const rgb = (name) => value(new THREE.Vector3(about[`${name}_r`], about[`${name}_g`], about[`${name}_b`]));
  const xyz = (name) => value(new THREE.Vector3(about[`${name}_x`], about[`${name}_y`], about[`${name}_z`]));
  const turn = new THREE.Matrix3().set(
    about.m00, about.m01, about.m02, about.m10, about.m11, about.m12, about.m20, about.m21, about.m22,
  );
  const ramp = new Float32Array(4 * 256);
  for (let i = 0; i < 256; i++) for (let c = 0; c < 3; c++) ramp[4 * i + c] = arrays.ramp[3 * i + c];
  const linear = THREE.LinearFilter;
  return {
    eye: value(new THREE.Vector3()), lamp: value(new THREE.Vector3()), axis: value(new THREE.Vector3()),
    size: value(new THREE.Vector2()), perPixel: value(1), palette: value(palette),
    tissue: value(volume(arrays.tissue, about.edge)), relief: value(volume(arrays.relief, about.edge)),
    ramp: value(texture(half(ramp), 256, 1, THREE.RGBAFormat, THREE.HalfFloatType, linear)),
    spot: value(texture(half(arrays.spot), 512, 1, THREE.RedFormat, THREE.HalfFloatType, linear)),
    turn: value(turn), tissuePlace: xyz("tissue"), reliefPlace: xyz("relief"),
    tissuePerMm: value(about.tissue_per_mm), reliefPerMm: value(about.relief_per_mm),
    edge: value(about.edge), steps: value(about.steps), rampBlood: value(about.rampBlood),
    blood: value(about.blood), blotches: value(about.blotches), vessels: value(about.vessels),
    fineVessels: value(about.fine_vessels), vessel: value(about.vessel), fineVessel: value(about.fine_vessel),
    mucus: value(about.mucus), mucusRgb: rgb("mucus"), lightRgb: rgb("light"), ambient: rgb("ambient"),
    spotAmbient: rgb("spot_ambient"), wrap: rgb("wrap"),
    attenuation: value(new THREE.Vector3(about.constant, about.linear, about.quadratic)),
    reliefSlope: value(about.relief), gloss: value(about.gloss), sheen: value(about.sheen), film: value(about.film),
    tissueRough: value(about.tissue), bounce: value(about.bounce), cosineCut: value(about.cosine_cut),
    vignette: value(about.vignette), brightness: value(1), tint: value(0),
  };
}

function half(values) {
  return Uint16Array.from(values, (one) => THREE.DataUtils.toHalfFloat(one));
}

function volume(data, edge) {
  const made = new THREE.Data3DTexture(data, edge, edge, edge);
  made.format = THREE.RGBAFormat;
  made.type = THREE.ByteType;
  made.internalFormat = "RGBA8_SNORM";
  made.minFilter = made.magFilter = THREE.LinearFilter;
  made.wrapS = made.wrapT = made.wrapR = THREE.RepeatWrapping;
  made.unpackAlignment = 1;
  made.needsUpdate = true;
  return made;
}

function texture(data, width, height, format, type, filter) {
  const made = new THREE.DataTexture(data, width, height, format, type);
  made.minFilter = made.magFilter = filter;
  made.needsUpdate = true;
  return made;
}

function screenMaterial(fragmentShader, uniforms) {
  return new THREE.RawShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: SCREEN_VERTEX, fragmentShader, uniforms, depthTest: false, depthWrite: false,
  });
}
