// What the painter draws with that is of no case: the shaders, which are translated from those of the server, what
// their variables are called, and the tables of the colours.

import colors from "../../shaders/colors.json";
import mesh from "../../shaders/mesh.vert.glsl";
import names from "../../shaders/names.json";
import reduce from "../../shaders/reduce.frag.glsl";
import screen from "../../shaders/screen.vert.glsl";
import shrink from "../../shaders/shrink.vert.glsl";
import slice from "../../shaders/slice.frag.glsl";
import trace from "../../shaders/trace.frag.glsl";
import type { Equipment } from "./gl.ts";
import probeFragment from "./probe.frag.glsl";
import probeVertex from "./probe.vert.glsl";

export const EQUIPMENT: Equipment = {
  shaders: {
    "mesh.vert.glsl": mesh,
    "reduce.frag.glsl": reduce,
    "screen.vert.glsl": screen,
    "shrink.vert.glsl": shrink,
    "slice.frag.glsl": slice,
    "trace.frag.glsl": trace,
  },
  names,
  probe: [probeVertex, probeFragment],
  colors,
};
