// The one script of all documents. They have nearly everything in common, and the parts of a script that is split cost more than they save.

import { comparing } from "../compare/main.tsx";
import { launching } from "../launch/main.tsx";
import { reading } from "../page/main.tsx";

/** By the class of the body. */
const DOCUMENTS: Readonly<Record<string, () => Promise<void>>> = { reading, comparing, launching };

await DOCUMENTS[document.body.className]?.();
