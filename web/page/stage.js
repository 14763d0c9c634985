// The head on the screen. All heads stand in the axes of a face: metres, x to its left, y up, z to the front.
import { coloured } from "./colours.js";
import {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, GLTFLoader, Group, HemisphereLight, Mesh, MeshoptDecoder,
  MeshStandardMaterial, OrbitControls, PerspectiveCamera, Scene, SRGBColorSpace, TextureLoader, Vector3, WebGLRenderer,
} from "./three.js";

// What the camera looks at: the middle of a face; and from where.
const MIDDLE = new Vector3(0, -0.022, 0.03);
const FROM = new Vector3(0.08, 0.01, 0.69);
const TURN = 0.1;

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(28, 1, 0.02, 50);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.turned = new Group();
    this.scene.add(this.turned);
    this.parts = [];
    this.light();
    this.front();
    new ResizeObserver(() => this.fit()).observe(canvas);
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  light() {
    this.scene.add(new HemisphereLight(new Color(0xffffff), new Color(0x8a8f98), 1.1));
    for (const [x, y, z, strength] of [[0.6, 0.9, 1.2, 1.9], [-1.2, 0.3, 0.6, 0.7], [0.2, 0.8, -1.2, 0.8]]) {
      const lamp = new DirectionalLight(0xffffff, strength);
      lamp.position.set(x, y, z);
      this.scene.add(lamp);
    }
  }

  front() {
    this.camera.position.copy(FROM);
    this.controls.target.copy(MIDDLE);
    this.controls.update();
    this.draw();
  }

  key(event) {
    const away = this.camera.position.clone().sub(this.controls.target);
    const side = new Vector3().crossVectors(this.camera.up, away).normalize();
    const keys = {
      ArrowLeft: () => away.applyAxisAngle(this.camera.up, TURN),
      ArrowRight: () => away.applyAxisAngle(this.camera.up, -TURN),
      ArrowUp: () => away.applyAxisAngle(side, TURN),
      ArrowDown: () => away.applyAxisAngle(side, -TURN),
      "+": () => away.multiplyScalar(0.9),
      "-": () => away.multiplyScalar(1 / 0.9),
    };
    if (event.key === "Home") this.front();
    else if (keys[event.key]) {
      keys[event.key]();
      this.camera.position.copy(this.controls.target).add(away);
      this.controls.update();
    } else return;
    event.preventDefault();
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // A narrow window still shows the whole face.
    this.camera.fov = Math.min(70, 28 / Math.min(1, 1.1 * this.camera.aspect));
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Shows a head: what the worker has found, and the bytes of its file. Returns whether it shows what the file stores. */
  async show(head, file) {
    const isGlb = head.parts.length > 0;
    // What three.js cannot show, such as Draco's compression, talks in clay.
    const asMade = isGlb ? await glb(head, file).catch(() => undefined) : undefined;
    const shown = asMade ?? plain(head);
    this.turned.clear();
    for (const part of this.parts) part.geometry.dispose();
    const placed = new Group();
    placed.matrixAutoUpdate = false;
    placed.matrix.fromArray(head.place).invert();
    placed.add(shown.scene);
    this.turned.add(placed);
    this.parts = shown.parts;
    this.movesShapes = false;
    this.turns = !shown.isSkinned;
    this.front();
    return asMade !== undefined;
  }

  /** Whether poses are weights of the shapes that the file has; all rests until the next pose. */
  byShapes(are) {
    for (const part of this.parts) part.rest();
    this.movesShapes = are;
    this.draw();
  }

  /** Moves the vertices, `[V * 3]`, or the shapes of the file, `[N]`, and turns the head by a rotation vector. */
  pose(moved, head) {
    for (const part of this.parts) this.movesShapes ? part.weigh(moved) : part.move(moved);
    const angle = Math.hypot(...head);
    this.turned.quaternion.identity();
    if (this.turns && angle > 0) {
      this.turned.quaternion.setFromAxisAngle(new Vector3(...head).divideScalar(angle), angle);
    }
    this.draw();
  }

  /** Draws when the screen next does, however often it is called before. */
  draw() {
    this.waiting ??= requestAnimationFrame(() => {
      this.waiting = undefined;
      this.renderer.render(this.scene, this.camera);
    });
  }
}

/** A head without materials: clay, with eyes and teeth that can be told from it. */
function plain(head) {
  const { positions, triangles } = head;
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions.slice(), 3));
  geometry.setIndex(new BufferAttribute(triangles, 1));
  geometry.computeVertexNormals();
  geometry.setAttribute("color", new BufferAttribute(coloured(head), 3));
  const clay = new MeshStandardMaterial({ vertexColors: true, roughness: 0.62, metalness: 0, side: DoubleSide });
  const mesh = new Mesh(geometry, clay);
  mesh.frustumCulled = false;
  const place = geometry.getAttribute("position");
  const move = (moved) => {
    for (let i = 0; i < moved.length; i++) place.array[i] = positions[i] + moved[i];
    place.needsUpdate = true;
    geometry.computeVertexNormals();
  };
  return { scene: mesh, parts: [{ geometry, move, rest() {} }], isSkinned: false };
}

/** A GLB as its author made it; each primitive moves by its own vertices. */
async function glb({ parts, shapes }, file) {
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  // Pictures as elements: fetching them, as the loader does, is what this page forbids.
  loader.register((parser) => {
    parser.textureLoader = new TextureLoader(parser.options.manager);
    return { name: "pictures" };
  });
  const gltf = await loader.parseAsync(file, "");
  const meshes = [];
  gltf.scene.traverse((object) => object.isMesh && meshes.push(object));
  const numbers = (object) => gltf.parser.associations.get(object) ?? {};
  const shows = (object, node) => object && (numbers(object).nodes === node || shows(object.parent, node));
  const found = [];
  for (let p = 0; 5 * p < parts.length; p++) {
    const [node, mesh, primitive, first, end] = parts.slice(5 * p, 5 * p + 5);
    const object = meshes.find((object) => {
      const own = numbers(object);
      return own.meshes === mesh && (own.primitives ?? 0) === primitive && shows(object, node);
    });
    const own = [];
    for (let n = 0; 2 * n < shapes.length; n++) if (shapes[2 * n] === mesh) own.push([n, shapes[2 * n + 1]]);
    if (object) found.push(part(object, [first, end], own));
  }
  return { scene: gltf.scene, parts: found, isSkinned: meshes.some((mesh) => mesh.isSkinnedMesh) };
}

/** `shapes`: those of its mesh, each with its place among the weights and its number in the mesh. */
function part(object, [first, end], shapes) {
  // Primitives may share their arrays, and each moves by its own part of the mesh.
  const geometry = object.geometry.clone();
  const stored = new Float32Array(3 * (end - first));
  const position = geometry.getAttribute("position");
  for (let v = 0; v < end - first; v++) stored.set([position.getX(v), position.getY(v), position.getZ(v)], 3 * v);
  const now = new BufferAttribute(stored.slice(), 3);
  geometry.setAttribute("position", now);
  object.geometry = geometry;
  object.frustumCulled = false;
  const move = (moved) => {
    const to = now.array;
    for (let v = 0, m = 3 * first; v < to.length; v++, m++) to[v] = stored[v] + moved[m];
    now.needsUpdate = true;
  };
  const own = object.morphTargetInfluences ?? [];
  const known = shapes.filter(([, number]) => number < own.length);
  const atRest = [...own];
  const weigh = (weights) => {
    for (const [n, number] of known) own[number] = weights[n];
  };
  const rest = () => {
    now.array.set(stored);
    now.needsUpdate = true;
    atRest.forEach((weight, number) => (own[number] = weight));
  };
  return { geometry, move, weigh, rest };
}
