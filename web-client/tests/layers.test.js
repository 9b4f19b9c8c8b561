import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import test from 'node:test';
import { fileURLToPath } from 'node:url';

const ROOT = fileURLToPath(new URL('../', import.meta.url));

/** Who may import whom. */
const LAYERS = { protocol: [], connection: ['protocol'], view: ['connection', 'protocol'], page: ['view', 'connection', 'protocol'], docs: ['page'] };

const sources = Object.keys(LAYERS).flatMap((layer) =>
  readdirSync(`${ROOT}src/${layer}`).map((name) => ({ layer, name, text: readFileSync(`${ROOT}src/${layer}/${name}`, 'utf8') })),
);

test('layers import only what lies below them', () => {
  for (const { layer, name, text } of sources) {
    for (const [, path] of text.matchAll(/^import (?:.* from )?'([^']+)';$/gm)) {
      const other = /^\.\.\/(\w+)\//.exec(path)?.[1];
      if (other) assert.ok(LAYERS[layer].includes(other), `${layer}/${name} imports ${path}`);
      else assert.match(path, /^\.\//, `${layer}/${name} imports ${path}, which is not part of the client`);
    }
  }
});

test('pages hold no inline script or style and load nothing from elsewhere', () => {
  for (const page of ['index.html', 'docs.html']) {
    const html = readFileSync(ROOT + page, 'utf8');
    assert.doesNotMatch(html, /<style|style=|<script(?![^>]*\ssrc=)|\son\w+=/, page);
    assert.doesNotMatch(html, /(?:src|href)="(?:https?:)?\/\//, page);
  }
});

test('the page stays light', () => {
  const html = readFileSync(`${ROOT}index.html`, 'utf8');
  const loaded = [...html.matchAll(/(?:src|href)="\/assets\/([^"]+)"/g)].map(([, path]) => path);
  const total = [...new Set(loaded)].reduce((sum, path) => sum + readFileSync(ROOT + path).length, html.length);
  assert.ok(total < 200_000, `${total} bytes uncompressed; the promise is 200 kB`);
});

test('every module stays small enough to read', () => {
  for (const { layer, name, text } of sources) {
    const isGenerated = text.includes(' * Generated from ');
    assert.ok(isGenerated || text.split('\n').length <= 500, `${layer}/${name}`);
  }
});

test('the page preloads exactly the modules it uses', () => {
  const used = new Set();
  const visit = (path) => {
    if (used.has(path)) return;
    used.add(path);
    const text = readFileSync(ROOT + path, 'utf8');
    for (const [, relative] of text.matchAll(/^import (?:.* from )?'([^']+)';$/gm)) {
      visit(new URL(relative, `file:///${path}`).pathname.slice(1));
    }
  };
  visit('src/page/main.js');
  used.delete('src/page/main.js');
  const html = readFileSync(`${ROOT}index.html`, 'utf8');
  const preloaded = [...html.matchAll(/rel="modulepreload" href="\/assets\/([^"]+)"/g)].map(([, path]) => path);
  assert.deepEqual(preloaded.sort(), [...used].sort());
});
