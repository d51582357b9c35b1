// Vectors as arrays, and the two shapes that the page draws: a polytope from its half-spaces, and the surface on which
// sampled values cross a level.

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const subtract = (a, b) => a.map((x, i) => x - b[i]);
export const scale = (a, factor) => a.map((x) => x * factor);
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
export const norm = (a) => Math.hypot(...a);
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** A point of a plane or of space, in space. */
export const space = (point) => [point[0], point[1], point[2] ?? 0];

export function unit(a) {
  const length = norm(a);
  return length > 0 ? scale(a, 1 / length) : a;
}

/** Two unit vectors that span the plane perpendicular to a unit vector. */
function perpendicular(normal) {
  const axis = Math.abs(normal[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0];
  const first = unit(cross(normal, axis));
  return [first, cross(normal, first)];
}

/** Rotation matrix, row by row, of a vector along the axis, as long as the angle in rad. */
export function rotationMatrix(vector) {
  const angle = norm(vector);
  if (angle === 0) return [1, 0, 0, 0, 1, 0, 0, 0, 1];
  const [x, y, z] = scale(vector, 1 / angle);
  const c = Math.cos(angle), s = Math.sin(angle), t = 1 - c;
  return [
    t * x * x + c, t * x * y - s * z, t * x * z + s * y,
    t * x * y + s * z, t * y * y + c, t * y * z - s * x,
    t * x * z - s * y, t * y * z + s * x, t * z * z + c,
  ]; // prettier-ignore
}

/** Square in the plane through a point, perpendicular to a unit vector, about that point. */
export function square(normal, middle, half) {
  const [a, b] = perpendicular(normal);
  return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([p, q]) =>
    add(middle, add(scale(a, p * half), scale(b, q * half))),
  );
}

export const rotate = (matrix, v) => [0, 3, 6].map((row) => dot(matrix.slice(row, row + 3), v));

/** The part of a convex polygon in which `normal · x <= offset` (Sutherland and Hodgman 1974). */
function clip(polygon, normal, offset) {
  const kept = [];
  polygon.forEach((here, i) => {
    const next = polygon[(i + 1) % polygon.length];
    const a = dot(normal, here) - offset, b = dot(normal, next) - offset;
    if (a <= 0) kept.push(here);
    if (a < 0 !== b < 0 && a !== b) kept.push(add(here, scale(subtract(next, here), a / (a - b))));
  });
  return kept;
}

/** Faces of {x : normal · x <= offset for all half-spaces} in space, each as a polygon: its plane, clipped. */
export function polytopeFaces(halfSpaces) {
  const size = 4 * Math.max(...halfSpaces.map(({ offset }) => Math.abs(offset)), 1e-9);
  return halfSpaces.flatMap((face, index) => {
    let polygon = square(face.normal, scale(face.normal, face.offset), size);
    for (let i = 0; i < halfSpaces.length && polygon.length > 2; i++) {
      const other = halfSpaces[i];
      const same = dot(other.normal, face.normal) > 1 - 1e-9 && Math.abs(other.offset - face.offset) < 1e-9 * size;
      if (same && i < index) return [];
      if (!same) polygon = clip(polygon, other.normal, other.offset);
    }
    return polygon.length > 2 ? [{ normal: face.normal, polygon }] : [];
  });
}

/** Polygon of {x : normal · x <= offset for all half-spaces} in the plane. */
export function polytopePolygon(halfSpaces) {
  const size = 4 * Math.max(...halfSpaces.map(({ offset }) => Math.abs(offset)), 1e-9);
  const square = [[size, size], [-size, size], [-size, -size], [size, -size]];
  return halfSpaces.reduce((polygon, { normal, offset }) => clip(polygon, normal, offset), square);
}

/**
 * Quadrilaterals of the surface on which values of a grid cross zero: one vertex in each cell that the surface passes,
 * at the mean of its crossings (surface nets, Gibson 1998).
 */
export function surfaceNet({ counts, origin, step, values }) {
  const [nx, ny, nz] = counts;
  const at = (x, y, z) => x + nx * (y + ny * z);
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => [bits & 1, (bits >> 1) & 1, bits >> 2]);
  const edges = corners.flatMap((_, i) => [1, 2, 4].filter((bit) => !(i & bit)).map((bit) => [i, i | bit]));
  const vertices = new Array(values.length);
  for (let z = 0; z < nz - 1; z++) {
    for (let y = 0; y < ny - 1; y++) {
      for (let x = 0; x < nx - 1; x++) {
        const around = corners.map(([i, j, k]) => values[at(x + i, y + j, z + k)]);
        const inside = around.filter((value) => value >= 0).length;
        if (inside === 0 || inside === 8) continue;
        const sum = [0, 0, 0];
        let crossings = 0;
        for (const [p, q] of edges) {
          if (around[p] >= 0 === around[q] >= 0) continue;
          const share = around[p] / (around[p] - around[q]);
          for (let axis = 0; axis < 3; axis++) {
            sum[axis] += corners[p][axis] + share * (corners[q][axis] - corners[p][axis]);
          }
          crossings++;
        }
        const cell = [x, y, z];
        vertices[at(x, y, z)] = cell.map((c, axis) => origin[axis] + step[axis] * (c + sum[axis] / crossings));
      }
    }
  }
  const quads = [];
  const strides = [1, nx, nx * ny];
  for (let z = 1; z < nz - 1; z++) {
    for (let y = 1; y < ny - 1; y++) {
      for (let x = 1; x < nx - 1; x++) {
        const here = at(x, y, z);
        for (let axis = 0; axis < 3; axis++) {
          if (values[here] >= 0 === values[here + strides[axis]] >= 0) continue;
          const b = strides[(axis + 1) % 3], c = strides[(axis + 2) % 3];
          const quad = [here, here - b, here - b - c, here - c].map((index) => vertices[index]);
          if (quad.every(Boolean)) quads.push(values[here] >= 0 ? quad : quad.reverse());
        }
      }
    }
  }
  return quads;
}

/** Polygons of the area in which values of a plane grid are above zero: cells, clipped by interpolation. */
export function areaCells({ counts, origin, step, values }) {
  const [nx, ny] = counts;
  const polygons = [];
  for (let y = 0; y < ny - 1; y++) {
    for (let x = 0; x < nx - 1; x++) {
      const ring = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]];
      const polygon = [];
      ring.forEach(([i, j], corner) => {
        const [p, q] = ring[(corner + 1) % 4];
        const a = values[i + nx * j], b = values[p + nx * q];
        if (a >= 0) polygon.push([i, j]);
        if (a >= 0 !== b >= 0) polygon.push([i + (a / (a - b)) * (p - i), j + (a / (a - b)) * (q - j)]);
      });
      if (polygon.length > 2) {
        polygons.push(polygon.map(([i, j]) => [origin[0] + step[0] * i, origin[1] + step[1] * j, 0]));
      }
    }
  }
  return polygons;
}
