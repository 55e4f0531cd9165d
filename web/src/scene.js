// What is to be drawn, as plain values: nothing here touches the page or the network.

/** The named views, with the patient's direction at each edge of the picture. */
export const VIEWS = Object.freeze({
  left: { label: "Left", key: "l", edges: { left: "A", right: "P", top: "S", bottom: "I" } },
  right: { label: "Right", key: "r", edges: { left: "P", right: "A", top: "S", bottom: "I" } },
  anterior: { label: "Anterior", key: "a", edges: { left: "R", right: "L", top: "S", bottom: "I" } },
  posterior: { label: "Posterior", key: "p", edges: { left: "L", right: "R", top: "S", bottom: "I" } },
  superior: { label: "Superior", key: "s", edges: { left: "L", right: "R", top: "A", bottom: "P" } },
  inferior: { label: "Inferior", key: "i", edges: { left: "R", right: "L", top: "A", bottom: "P" } },
});

/** The slice planes, in the radiological manner: the patient's right at the picture's left. `axis` is of LPS. */
export const PLANES = Object.freeze({
  axial: { label: "Axial", axis: 2, edges: { left: "R", right: "L", top: "A", bottom: "P" } },
  coronal: { label: "Coronal", axis: 1, edges: { left: "R", right: "L", top: "S", bottom: "I" } },
  sagittal: { label: "Sagittal", axis: 0, edges: { left: "A", right: "P", top: "S", bottom: "I" } },
});

/** The step of the depth control, in mm. */
export const DEPTH_STEP_MM = 0.5;

/** The scene that a ready case is first shown with. */
export function firstScene(ready) {
  const { center, width } = ready.intensity.window;
  return {
    depth_mm: Math.min(8, deepest(ready)),
    view: "left",
    zoom: 1,
    window: { center, width },
    colormap: "grey",
    plane: "axial",
    position_mm: sliceRange(ready.grid, "axial").middle,
  };
}

/** The deepest depth on the control's steps, in mm. */
export function deepest(ready) {
  return Math.floor(ready.max_depth_mm / DEPTH_STEP_MM) * DEPTH_STEP_MM;
}

/** `depth_mm` on the control's steps and within the case; NaN becomes 0. */
export function clampDepth(depth_mm, ready) {
  const stepped = Math.round(depth_mm / DEPTH_STEP_MM) * DEPTH_STEP_MM;
  return Math.min(Math.max(stepped || 0, 0), deepest(ready));
}

/** The query of a render of `size` × `size` pixels. */
export function renderQuery(scene, view, size) {
  const query = new URLSearchParams({ depth_mm: String(scene.depth_mm), view });
  if (scene.zoom !== 1) query.set("zoom", String(scene.zoom));
  addColours(query, scene);
  query.set("width", String(size));
  query.set("height", String(size));
  return query.toString();
}

/** The query of the slice, with the outline of the cut on it. */
export function sliceQuery(scene) {
  const query = new URLSearchParams({ position_mm: String(scene.position_mm), depth_mm: String(scene.depth_mm) });
  addColours(query, scene);
  return query.toString();
}

function addColours(query, scene) {
  query.set("window", `${scene.window.center},${scene.window.width}`);
  if (scene.colormap !== "grey") query.set("colormap", scene.colormap);
}

/** From where to where a plane can move, in mm of LPS: the extent of the grid's voxel centres along its axis. */
export function sliceRange(grid, plane) {
  const row = grid.patient_from_voxel[PLANES[plane].axis];
  let min = row[3];
  let max = row[3];
  grid.size.forEach((count, axis) => {
    const reach = row[axis] * (count - 1);
    if (reach < 0) min += reach;
    else max += reach;
  });
  min = Math.ceil(min * 2) / 2;
  max = Math.floor(max * 2) / 2;
  return { min, max, middle: Math.round(min + max) / 2 };
}

/** The pixels to ask for so that a square of `css_pixels` looks sharp: a few sizes only, so that caches help. */
export function pictureSize(css_pixels, device_pixel_ratio) {
  const wanted = css_pixels * device_pixel_ratio;
  return Math.min(Math.max(Math.ceil(wanted / 128) * 128, 128), 1024);
}

/** A case's name in the list. */
export function caseTitle(one) {
  return one.name || `Case ${one.id.slice(0, 8)}`;
}

/** The words with a capital letter and a full stop. */
export function sentence(words) {
  const first = words.slice(0, 1).toUpperCase() + words.slice(1);
  return /[.!?…]$/.test(first) ? first : `${first}.`;
}

const STAGES = {
  reading: "reading the volume",
  mask: "reading the mask",
  closing: "closing the mask",
  distance: "measuring depths",
  core: "finding the core",
  forest: "growing the forest",
  mesh: "building the mesh",
  storing: "storing",
};

/** What a case is at, in words. */
export function caseStatus(one) {
  switch (one.state) {
    case "queued":
      return "waiting its turn";
    case "preparing": {
      const { stage, fraction } = one.progress ?? {};
      const percent = Number.isFinite(fraction) ? ` · ${Math.round(100 * fraction)} %` : "";
      return (STAGES[stage] ?? "preparing") + percent;
    }
    case "ready":
      return `ready · ${one.max_depth_mm.toFixed(1)} mm deep`;
    case "failed":
      return sentence(one.error?.detail ?? "could not be prepared");
    default:
      return one.state;
  }
}
