// Colours of a head that has none, by what its vertices belong to.
import { Color, Matrix4, Vector3 } from "./three.js";

// Skin, jaw, skull, inside of the mouth, hair, eyeballs, anything else.
const OF_ROLE = [0xc9b3a4, 0xe8e0d4, 0xe8e0d4, 0x8f5650, 0x4a382e, 0xf1eeea, 0xa9a39d].map((hex) => new Color(hex));
const EYEBALL = 5;
const IRIS = new Color(0x4f6b7a);
const PUPIL = new Color(0x15181b);
// How far from the direction of a look they reach, as cosines.
const IRIS_REACH = Math.cos((29 * Math.PI) / 180);
const PUPIL_REACH = Math.cos((12 * Math.PI) / 180);

/** A colour of each vertex, `[V * 3]`. */
export function coloured({ positions, place, roles, pieces }) {
  const colours = new Float32Array(positions.length);
  roles.forEach((role, v) => OF_ROLE[role].toArray(colours, 3 * v));
  const toFace = new Matrix4().fromArray(place).invert();
  const eyes = new Map();
  roles.forEach((role, v) => {
    if (role !== EYEBALL) return;
    if (!eyes.has(pieces[v])) eyes.set(pieces[v], []);
    eyes.get(pieces[v]).push([v, new Vector3().fromArray(positions, 3 * v).applyMatrix4(toFace)]);
  });
  for (const points of eyes.values()) {
    const low = new Vector3().copy(points[0][1]);
    const high = low.clone();
    for (const [, at] of points) {
      low.min(at);
      high.max(at);
    }
    const middle = low.add(high).multiplyScalar(0.5);
    for (const [v, at] of points) {
      const ahead = at.sub(middle).normalize().z;
      if (ahead > IRIS_REACH) (ahead > PUPIL_REACH ? PUPIL : IRIS).toArray(colours, 3 * v);
    }
  }
  return colours;
}
