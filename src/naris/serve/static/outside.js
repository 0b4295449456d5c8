// The anatomy from outside, as glass, with the scope in it, where it has been, and what was saved.

import * as THREE from "./vendor/three.module.min.js";
import { GLASS_FRAGMENT, GLASS_VERTEX } from "./shaders.js";
import { setCamera } from "./inside.js";
import { pinch } from "./touch.js";

const SHAFT_MM = 60, SHAFT_RADIUS_MM = 1.3, VIEW_MM = 9;
const TRAIL_POINTS = 4000, TRAIL_STEP_MM = 0.25;
const TURN_PER_PX = 0.008, ZOOM_PER_STEP = 1.1, WHEEL_PX = 100;
const TURN_PER_KEY = 0.1;
const FOV_DEG = 28, FILLS = 1 / Math.sin((FOV_DEG / 2) * (Math.PI / 180)); // so far away, in radii, all is in the picture
const ORBITS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }; // as a drag there does
const ZOOMS = { "+": 1 / ZOOM_PER_STEP, "=": 1 / ZOOM_PER_STEP, "-": ZOOM_PER_STEP };

export class Outside {
  constructor(canvas, geometry, palette, surface) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FOV_DEG, 1, 1, 3000);
    this.glass = new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3, vertexShader: GLASS_VERTEX, fragmentShader: GLASS_FRAGMENT, side: THREE.DoubleSide,
      transparent: true, depthWrite: false, uniforms: { palette: { value: palette }, density: { value: 0.3 } },
    });
    this.mesh = new THREE.Mesh(geometry, this.glass);
    this.mesh.renderOrder = 2;
    this.scene.add(this.mesh);
    const [low, high] = surface.about.bounds.map((corner) => new THREE.Vector3(...corner));
    this.middle = low.clone().add(high).multiplyScalar(0.5);
    this.radius = high.distanceTo(low) / 2;
    this.turn = [2.2, 0.35]; // from the front and the patient's right, a little from above
    this.reach = this.radius * FILLS;
    this.lines = surface.about.passages.map((_, k) => this.#line(surface.arrays[`passage${k}`], 0x8a8f98));
    this.#scope();
    this.#makeTrail();
    this.marks = new THREE.Group();
    this.ghosts = new THREE.Group();
    this.scene.add(this.marks, this.ghosts);
    this.ray = new THREE.Raycaster();
    this.brush = null; // what a drag does instead of turning, while regions are painted
    this.#listen(canvas);
  }

  resize(width, height, ratio = 1) {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(Math.max(width, 2), Math.max(height, 2), false);
    this.camera.aspect = Math.max(width, 2) / Math.max(height, 2);
    this.camera.updateProjectionMatrix();
  }

  draw(pose, fovDeg, aspect) {
    this.#stand();
    setCamera(this.scope, pose);
    const up = Math.tan((fovDeg * Math.PI) / 360);
    this.frustum.scale.set(up * aspect, up, 1);
    this.renderer.render(this.scene, this.camera);
  }

  /** The scope has come here: the trail grows, the shaft points along `shaft` (3×3, without optics). */
  follow(position, shaft) {
    this.rod.position.set(...position);
    const along = new THREE.Vector3(shaft[0][2], shaft[1][2], shaft[2][2]);
    this.rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, -1, 0), along);
    const last = this.last;
    if (last && Math.hypot(...position.map((one, axis) => one - last[axis])) < TRAIL_STEP_MM) return;
    this.last = [...position];
    const buffer = this.trail.geometry.attributes.position;
    if (this.trailed === TRAIL_POINTS) {
      buffer.array.copyWithin(0, 3);
      this.trailed--;
    }
    buffer.array.set(position, 3 * this.trailed++);
    buffer.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, this.trailed);
  }

  clearTrail() {
    this.trailed = 0;
    this.last = null;
    this.trail.geometry.setDrawRange(0, 0);
  }

  /** Small frustums where keyframes, or what a model believes in, stand. */
  mark(poses, isGhost = false) {
    const group = isGhost ? this.ghosts : this.marks;
    for (const one of group.children) {
      one.geometry.dispose();
      one.material.dispose();
    }
    group.clear();
    for (const pose of poses) {
      const one = frustum(isGhost ? 0xd060d0 : 0xe0a030, 2.5);
      one.matrixAutoUpdate = false;
      setCamera(one, pose);
      group.add(one);
    }
  }

  /** What a click meets first: the number of a `corner` of the wall, and the `place` on it (mm); null beside it. */
  hit(event) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1, y = 1 - (2 * (event.clientY - box.top)) / box.height;
    this.#stand();
    this.ray.setFromCamera(new THREE.Vector2(x, y), this.camera);
    const [first] = this.ray.intersectObject(this.mesh, false);
    return first ? { corner: first.face.a, place: first.point.toArray() } : null;
  }

  #stand() {
    const [angle, height] = this.turn;
    const reach = this.reach / Math.min(this.camera.aspect, 1); // what fits upwards does so sideways
    const flat = Math.cos(height) * reach;
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(
      this.middle.x + flat * Math.cos(angle), this.middle.y - flat * Math.sin(angle), this.middle.z + reach * Math.sin(height),
    );
    this.camera.lookAt(this.middle);
    this.camera.updateMatrixWorld(true);
  }

  #line(points, colour) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity: 0.8 }));
    this.scene.add(line);
    return line;
  }

  #scope() {
    this.scope = new THREE.Group();
    this.scope.matrixAutoUpdate = false;
    this.frustum = frustum(0xffd23c, VIEW_MM);
    this.scope.add(this.frustum);
    const tube = new THREE.CylinderGeometry(SHAFT_RADIUS_MM, SHAFT_RADIUS_MM, SHAFT_MM, 12, 1);
    tube.translate(0, SHAFT_MM / 2, 0);
    this.rod = new THREE.Mesh(tube, new THREE.MeshBasicMaterial({ color: 0x9aa4b2, transparent: true, opacity: 0.75 }));
    this.scene.add(this.scope, this.rod);
  }

  #makeTrail() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL_POINTS), 3));
    this.trail = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: 0x3ca0e0 }));
    this.trail.frustumCulled = false;
    this.scene.add(this.trail);
    this.clearTrail();
  }

  #listen(canvas) {
    const fingers = new Map();
    let stroke = null; // the pointer that paints, and the brush
    this.dragged = 0;
    canvas.addEventListener("pointerdown", (event) => {
      if (stroke) {
        stroke.brush.cancel(); // two fingers come nearer, and paint nothing
        fingers.set(stroke.pointer, stroke.at);
        stroke = null;
      }
      const at = [event.clientX, event.clientY];
      const met = this.brush && !event.shiftKey && !fingers.size && this.hit(event);
      if (met) {
        stroke = { pointer: event.pointerId, brush: this.brush, at };
        this.brush.begin(met.place);
        canvas.setPointerCapture(event.pointerId);
        return;
      }
      fingers.set(event.pointerId, at);
      this.dragged = 0;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (stroke) {
        if (stroke.pointer !== event.pointerId) return;
        stroke.at = [event.clientX, event.clientY];
        stroke.brush.move(this.hit(event)?.place);
        return;
      }
      const from = fingers.get(event.pointerId);
      if (!from) return;
      const by = [event.clientX - from[0], event.clientY - from[1]], spread = pinch(fingers);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      this.dragged += Math.abs(by[0]) + Math.abs(by[1]);
      if (fingers.size === 1) this.orbit(by[0] * TURN_PER_PX, by[1] * TURN_PER_PX);
      else if (spread > 0) this.zoom(spread / Math.max(pinch(fingers), 1));
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => {
        if (stroke?.pointer === event.pointerId) {
          stroke.brush.end();
          stroke = null;
        }
        fingers.delete(event.pointerId);
      });
    }
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const turn = ORBITS[event.code], zoom = ZOOMS[event.key];
      if (!turn && !zoom) return; // all else steers the scope from here, too
      event.preventDefault();
      event.stopPropagation();
      if (turn) this.orbit(turn[0] * TURN_PER_KEY, turn[1] * TURN_PER_KEY);
      else this.zoom(zoom);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(ZOOM_PER_STEP ** (event.deltaY / WHEEL_PX));
    }, { passive: false });
  }

  orbit(sideways, upwards) {
    this.turn[0] += sideways;
    this.turn[1] = Math.min(Math.max(this.turn[1] + upwards, -1.5), 1.5);
  }

  /** Lines and shaft stand out from a ground that is dark or light. */
  shown(isDark) {
    for (const line of this.lines) line.material.color.set(isDark ? 0xd8dee6 : 0x6b7078);
    this.rod.material.color.set(isDark ? 0xdfe6ee : 0x9aa4b2);
  }

  zoom(factor) {
    this.reach = Math.min(Math.max(this.reach * factor, this.radius * 0.6), this.radius * 12);
  }
}

/** A pyramid along −z of half width and height 1 at 1, as long as `length`. */
function frustum(colour, length) {
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => [x * length, y * length, -length]);
  const points = [];
  corners.forEach((corner, k) => points.push(0, 0, 0, ...corner, ...corner, ...corners[(k + 1) % 4]));
  const up = [[-0.3, 1.05], [0, 1.4], [0.3, 1.05]].map(([x, y]) => [x * length, y * length, -length]);
  points.push(...up[0], ...up[1], ...up[1], ...up[2]);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  const made = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour }));
  if (length < VIEW_MM) made.geometry.scale(0.45, 0.45, 1);
  return made;
}
