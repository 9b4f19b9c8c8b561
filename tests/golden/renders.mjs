/**
 * The golden set of images: SHA-256 of the EXR bytes of renders over techniques, reconstructions, presets, material modes,
 * outputs and seeds. Bytes depend on the device and its driver, so this is a script and not a test: record with the
 * program before a change, compare with the program after it, on one machine.
 *
 *   node tests/golden/renders.mjs record  FILE.json [PROGRAM]
 *   node tests/golden/renders.mjs compare FILE.json [PROGRAM]
 *
 * PROGRAM is target/release/surfelcast by default. Scenes in $SURFELCAST_SHARED (or ../shared) are used where they are.
 * Exit status: 0 everything is equal, 1 something differs (each render is named), 2 bad usage.
 */

import { spawnSync } from 'node:child_process';
import { createHash } from 'node:crypto';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';

const ROOT = fileURLToPath(new URL('../..', import.meta.url));
const SHARED = process.env.SURFELCAST_SHARED ?? join(ROOT, '../shared');

const CORNELL = 'demo:cornell_box';
const INTERIOR = 'demo:interior';

/** Name of a render, then its scene and options. Only options of the fixed command-line interface. */
const RENDERS = [
  ['path', CORNELL, '--technique path --spp 8'],
  ['path, seed 7', CORNELL, '--technique path --spp 8 --seed 7'],
  ['path, lambert', CORNELL, '--technique path --spp 8 --materials lambert'],
  ['path, interior', INTERIOR, '--technique path --spp 4'],
  ['path, audited goal', CORNELL, '--technique path --max-error 0.05'],
  ['gradient', CORNELL, '--technique gradient --spp 8'],
  ['gradient, seed 7', CORNELL, '--technique gradient --spp 8 --seed 7'],
  ['gradient_l1', CORNELL, '--technique gradient_l1 --spp 8'],
  ['surfel', CORNELL, '--technique surfel --frames 6'],
  ['surfel, seed 7', CORNELL, '--technique surfel --frames 6 --seed 7'],
  ['surfel, lambert', CORNELL, '--technique surfel --frames 6 --materials lambert'],
  ['surfel, interior', INTERIOR, '--technique surfel --frames 4'],
  ['surfel, interior kitchen', INTERIOR, '--technique surfel --frames 4 --camera kitchen'],
  ['surfel, settled', CORNELL, '--technique surfel --frames 40'],
  ['surfel, preview', CORNELL, '--technique surfel --frames 6 --preset preview'],
  ['surfel, high', CORNELL, '--technique surfel --frames 4 --preset high'],
  ['surfel, none', CORNELL, '--technique surfel --frames 6 --reconstruction none'],
  ['surfel, regression', CORNELL, '--technique surfel --frames 6 --reconstruction regression'],
  ['surfel, image', CORNELL, '--technique surfel --frames 6 --reconstruction image'],
  ['direct', CORNELL, '--technique path --spp 4 --aov direct'],
  ['indirect', CORNELL, '--technique surfel --frames 4 --aov indirect'],
  ['irradiance', CORNELL, '--technique surfel --frames 4 --aov irradiance'],
  ['reflection', CORNELL, '--technique surfel --frames 4 --aov reflection'],
  ['albedo', INTERIOR, '--spp 1 --aov albedo'],
  ['normal', INTERIOR, '--spp 1 --aov normal'],
  ['depth', INTERIOR, '--spp 1 --aov depth'],
  ['variance', CORNELL, '--technique path --spp 8 --aov variance'],
  ['surfel_coverage', CORNELL, '--technique surfel --frames 4 --aov surfel_coverage'],
  ['surfel_rays', CORNELL, '--technique surfel --frames 4 --aov surfel_rays'],
  ['bars', 'bars.glb', '--technique surfel --frames 4 --materials lambert'],
  ['glossy', 'cornell_glossy.glb', '--technique surfel --frames 6'],
  ['transmission', 'feature_transmission.glb', '--technique path --spp 8'],
  ['alpha', 'feature_alpha.glb', '--technique surfel --frames 4'],
  ['cesium man', 'khr_cesium_man.glb', '--technique path --spp 4'],
  ['morph cube', 'khr_animated_morph_cube.glb', '--technique surfel --frames 4'],
  ['many lights', 'many_lights.glb', '--technique surfel --frames 2'],
  ['metal rough', 'feature_metal_rough.glb', '--technique gradient --spp 4'],
  ['far origin', 'far_origin.glb', '--technique surfel --frames 4 --materials lambert'],
];

const [mode, file, program = join(ROOT, process.env.CARGO_TARGET_DIR ?? 'target', 'release/surfelcast')] = process.argv.slice(2);
if (!file || !['record', 'compare'].includes(mode)) {
  console.error('usage: node tests/golden/renders.mjs record|compare FILE.json [PROGRAM]');
  process.exit(2);
}

/** Hash of one render's bytes, or what the program said of why there is none. */
function render(folder, scene, options) {
  const path = scene.startsWith('demo:') ? scene : join(SHARED, 'scenes', scene);
  if (!scene.startsWith('demo:') && !existsSync(path)) return undefined;
  const output = join(folder, 'image.exr');
  const words = ['render', path, '--output', output, '--size', '96x72', ...options.split(' ')];
  const { status, stderr } = spawnSync(program, words, { encoding: 'utf8' });
  if (status !== 0) return `exit ${status}: ${stderr.trim()}`;
  return createHash('sha256').update(readFileSync(output)).digest('hex');
}

const folder = mkdtempSync(join(tmpdir(), 'surfelcast-golden-'));
const golden = mode === 'compare' ? JSON.parse(readFileSync(file, 'utf8')) : {};
const found = {};
let differing = 0;
let compared = 0;
for (const [name, scene, options] of RENDERS) {
  const hash = render(folder, scene, options);
  if (hash === undefined) {
    console.log(`skipped  ${name}: ${scene} is not in ${SHARED}/scenes`);
    continue;
  }
  found[name] = hash;
  if (mode === 'record') {
    console.log(`recorded ${name}: ${hash.slice(0, 60)}`);
    continue;
  }
  compared += 1;
  const isEqual = golden[name] === hash;
  if (!isEqual) differing += 1;
  console.log(isEqual ? `equal    ${name}` : `DIFFERS  ${name}: ${golden[name] ?? 'not recorded'} -> ${hash}`);
}
rmSync(folder, { recursive: true, force: true });
if (mode === 'record') writeFileSync(file, `${JSON.stringify(found, null, 2)}\n`);
else console.log(`${compared - differing} of ${compared} renders have the recorded bytes`);
process.exit(differing === 0 ? 0 : 1);
