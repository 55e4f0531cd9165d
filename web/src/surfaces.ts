// Who draws the cortex in this browser.

export { createSurface } from "./cortex.ts";
