/**
 * The real server as a child process.
 */

import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

const BINARY = process.env.SURFELCAST_BIN ?? fileURLToPath(new URL('../../../target/release/surfelcast', import.meta.url));
/** Opening a device and loading the demo scenes takes a while on a software device. */
const START_MS = 600_000;

/**
 * Starts the server and waits until it reports its address.
 * @param {object} options
 * @param {string} options.data folder for its data
 * @param {number} [options.port] 0 chooses one
 * @param {string[]} [options.args]
 */
export async function startServer({ data, port = 0, args = [] }) {
  if (!existsSync(BINARY)) {
    throw new Error(`${BINARY} does not exist: run \`cargo build --release -p surfelcast\`, or name the program in SURFELCAST_BIN`);
  }
  const child = spawn(BINARY, ['serve', '--bind', `127.0.0.1:${port}`, '--data', data, ...args], { stdio: ['ignore', 'pipe', 'pipe'] });
  let log = '';
  const gone = new Promise((resolve) => child.once('exit', resolve));
  const address = await new Promise((resolve, reject) => {
    const timer = setTimeout(() => {
      child.kill('SIGKILL');
      reject(new Error(`no address within ${START_MS} ms; its output:\n${log}`));
    }, START_MS);
    const onOutput = (chunk) => {
      log += chunk;
      const found = /http:\/\/127\.0\.0\.1:\d+/.exec(log);
      if (!found) return;
      clearTimeout(timer);
      resolve(found[0]);
    };
    child.stdout.on('data', onOutput);
    child.stderr.on('data', onOutput);
    child.once('error', reject);
    child.once('exit', (code) => reject(new Error(`the server ended with ${code}; its output:\n${log}`)));
  });
  await ready(address, () => log);
  return {
    address,
    port: Number(new URL(address).port),
    log: () => log,
    async kill() {
      child.kill('SIGKILL');
      await gone;
    },
  };
}

async function ready(address, log) {
  for (const end = Date.now() + START_MS; ; ) {
    const answer = await fetch(`${address}/readyz`).catch(() => undefined);
    if (answer?.ok) return;
    if (Date.now() > end) throw new Error(`not ready within ${START_MS} ms; its output:\n${log()}`);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}
