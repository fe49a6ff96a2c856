// A rigid body in an engine of the web, as a CSV file that `lagrange-bench judge` reads:
// node follow.mjs ENGINE SETTING STEP STEPS EVERY BODY
// ENGINE: a file of this folder. SETTING: "default", or any other word for its best. STEP: s; STEPS: how many; EVERY: steps
// between two rows. BODY: JSON, as of `Body` in ../follow.py.
//
// An adapter exports start(body, h, best), which gives step() and read(): the centre of mass, the quaternion with the scalar
// last, the angular velocity in the world.
const [engine, setting, step, steps, every, body] = process.argv.slice(2);
const { start } = await import(`./${engine}.mjs`);
console.log = () => {}; // engines greet
const run = await start(JSON.parse(body), Number(step), setting !== "default");
const rows = ["t,x,y,z,qx,qy,qz,qw,wx,wy,wz"];
for (let i = 0; i <= steps; i++) {
  if (i % every === 0) rows.push([i * step, ...run.read()].join(","));
  run.step();
}
process.stdout.write(`${rows.join("\n")}\n`, () => process.exit(0)); // engines may keep node alive
