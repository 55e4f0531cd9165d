// Who draws the cortex in this browser.

import { createServerSurface } from "./server-surface.ts";
import type { CreateSurface } from "./surface.ts";

export const createSurface: CreateSurface = (host, shown, options) => createServerSurface(host, shown, options);
