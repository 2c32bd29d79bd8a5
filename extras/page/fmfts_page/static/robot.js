// Says whose page this is, and leads back, where the server shows several robots: /robot/NAME/.

export function sayRobot() {
  const name = location.pathname.match(/^\/robot\/([\w-]+)\//)?.[1];
  if (name === undefined) return;
  const line = document.getElementById("robot");
  line.hidden = false;
  line.querySelector("b").textContent = name;
  document.title = `${name}: fmfts`;
}
