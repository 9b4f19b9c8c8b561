/**
 * Serves the web client as the real server does: `index.html` at `/`, the rest under `/assets/`, the same policy.
 */

import { readFile } from 'node:fs/promises';
import { extname, join, normalize, sep } from 'node:path';
import { fileURLToPath } from 'node:url';

const CLIENT = fileURLToPath(new URL('../../../web-client/', import.meta.url));

const TYPES = { '.html': 'text/html; charset=utf-8', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml' };

const POLICY =
  "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' ws: wss:; style-src 'self'; script-src 'self'";

/**
 * Answers a request for a file of the client.
 * @param {string} path of the request
 * @param {import('node:http').ServerResponse} response
 */
export async function serveFile(path, response) {
  const file = path === '/' ? 'index.html' : path === '/docs' ? 'docs.html' : path.replace(/^\/assets\//, '');
  const full = normalize(join(CLIENT, file));
  if (!full.startsWith(CLIENT.endsWith(sep) ? CLIENT : CLIENT + sep) || (file === path && path !== '/')) {
    response.writeHead(404).end();
    return;
  }
  try {
    const body = await readFile(full);
    response.writeHead(200, {
      'content-type': TYPES[extname(full)] ?? 'application/octet-stream',
      'content-security-policy': POLICY,
      'cache-control': 'no-cache',
    });
    response.end(body);
  } catch {
    response.writeHead(404).end();
  }
}
