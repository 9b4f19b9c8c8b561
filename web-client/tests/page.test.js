import assert from 'node:assert/strict';
import test from 'node:test';
import { auditedError, bytes, field, metres, milliseconds, percent, reasonText, resolutionText, significant } from '../src/page/format.js';
import { colorOf, directionOf, evOf, factorOf, hexOf, logScale, skyAngles } from '../src/page/quantities.js';
import { problemText, streamPath } from '../src/page/scene-service.js';

test('an audited error has the digits that its uncertainty justifies', () => {
  assert.equal(auditedError({ rmse: 0.0062, std_error: 0.0012 }), 'RMSE 0.006 ± 0.001');
  assert.equal(auditedError({ rmse: 0.0062, std_error: 0.0008 }), 'RMSE 0.0062 ± 0.0008');
  assert.equal(auditedError({ rmse: 0.0062, std_error: 0 }), 'RMSE 0.0062 ± 0.0000');
});

test('numbers have a suitable unit at every size', () => {
  assert.deepEqual([0, 999, 1234, 56_789, 1_234_567, 98_765_432].map(bytes), ['0 B', '999 B', '1.2 kB', '57 kB', '1.2 MB', '99 MB']);
  assert.deepEqual([0.04, 9.94, 123.4].map(milliseconds), ['0.0 ms', '9.9 ms', '123 ms']);
  assert.deepEqual([0, 1, 1.23456789, 25, 1e-7, 1.5e9].map(field), ['0', '1', '1.2346', '25', '1.000e-7', '1.500e+9']);
});

test('numbers of the inspector are short', () => {
  assert.deepEqual([0, 0.012345, -1.23456, 123.456, 98_765.4, 1.5e7, 2e-6].map((value) => significant(value, 3)), ['0', '0.0123', '-1.23', '123', '98765', '1.50e+7', '2.00e-6']);
  assert.deepEqual([0, 0.0004, 0.0321, 0.0994, 0.1, 0.754, 1].map(percent), ['0 %', '0.0 %', '3.2 %', '9.9 %', '10 %', '75 %', '100 %']);
  assert.deepEqual([12.345, 1, 0.625, 0.0124, 0.0021, 0].map(metres), ['12.3 m', '1.00 m', '63 cm', '1.2 cm', '2.1 mm', '0 mm']);
});

test('a reduced resolution has its reason', () => {
  assert.equal(resolutionText({ scale: 0.6, reason: 'device' }), '60 % resolution: the device cannot render full frames in time');
  assert.equal(resolutionText({ scale: 0.75, reason: 'link' }), '75 % resolution: the bandwidth of the connection is too low');
  assert.equal(resolutionText({ scale: 1, reason: 'link' }), '', 'that is about quality');
  assert.equal(resolutionText({ scale: 0.5, reason: '' }), '50 % resolution');
  assert.equal(reasonText('solar flare'), 'solar flare', 'of a newer server');
  assert.equal(reasonText(''), '');
});

test('colours survive the conversion to sRGB and back', () => {
  for (const hex of ['#000000', '#ffffff', '#123456', '#ff8000', '#0a0b0c']) assert.equal(hexOf(colorOf(hex)), hex);
  assert.equal(hexOf([2, -1, 0.5]), '#ff00bc', 'clamped');
});

test('exposure in EV is a power of two', () => {
  assert.equal(factorOf(3), 8);
  assert.equal(evOf(0.25), -2);
});

test('sky angles and directions agree', () => {
  const noonSouth = directionOf({ azimuth: 180, elevation: 45 });
  assert.ok(Math.abs(noonSouth[0]) < 1e-12 && noonSouth[1] < 0 && noonSouth[2] < 0, 'from +Z above, shining to -Z and down');
  const east = directionOf({ azimuth: 90, elevation: 0 });
  assert.ok(Math.abs(east[0] + 1) < 1e-12, 'from +X, shining to -X');
  for (const azimuth of [0, 45, 123, 270, 359]) {
    for (const elevation of [-89, -30, 0, 60, 89]) {
      const back = skyAngles(directionOf({ azimuth, elevation }));
      assert.ok(Math.abs(back.azimuth - azimuth) < 1e-9 && Math.abs(back.elevation - elevation) < 1e-9);
    }
  }
  assert.deepEqual(skyAngles([0, -1, 0]), { azimuth: 0, elevation: 90 });
});

test('the logarithmic slider has zero at its end and is its own inverse', () => {
  const scale = logScale(1e-3, 1e6, 900);
  assert.equal(scale.value(0), 0);
  assert.ok(Math.abs(scale.value(900) - 1e6) < 1e-3);
  assert.equal(scale.position(1e12), 900);
  assert.equal(scale.position(0), 0);
  for (const position of [1, 17, 450, 899]) assert.equal(scale.position(scale.value(position)), position);
});

test('refusals have the message of the problem document', () => {
  const problem = (document) => problemText(413, JSON.stringify(document));
  assert.equal(problem({ title: 'Too large', detail: 'body has 9 bytes, limit 8' }), 'Too large: body has 9 bytes, limit 8');
  assert.equal(problem({ title: 'Too large', detail: 'Too large: 9 bytes' }), 'Too large: 9 bytes');
  assert.equal(problem({ title: 'Too large' }), 'Too large');
  assert.equal(problem({}), 'The server answered with status 413.');
  assert.equal(problemText(502, '<html>'), 'The server answered with status 502.');
});

test('a session id is escaped in the path', () => {
  assert.equal(streamPath('a/../b'), '/v1/sessions/a%2F..%2Fb/stream');
});
