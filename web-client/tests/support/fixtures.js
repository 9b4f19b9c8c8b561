/**
 * Golden encodings shared with the Rust side.
 */

import { readdirSync, readFileSync } from 'node:fs';

const FOLDER = new URL('../../../protocol/fixtures/', import.meta.url);

export const json = (name) => JSON.parse(readFileSync(new URL(name, FOLDER), 'utf8'));

export function bytes(name) {
  const buffer = readFileSync(new URL(name, FOLDER));
  return buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + buffer.byteLength);
}

/** Names of the frames, without ending. */
export const frames = () =>
  readdirSync(FOLDER)
    .filter((name) => /^frame_.*\.bin$/.test(name))
    .map((name) => name.replace(/\.bin$/, ''));

/** Source of the Rust side of the protocol. */
export const rust = (file) => readFileSync(new URL(`../../../protocol/src/${file}`, import.meta.url), 'utf8');
