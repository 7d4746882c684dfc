// A file fills the form; a checked table is sent with the token, and its own page opens.

const table = document.getElementById("table");
const chosen = document.getElementById("file");

async function check(isNew) {
  const [file] = chosen.files;
  const text = (await file?.text())?.replace(/\r\n?/g, "\n");
  if (text === undefined || (!isNew && text === table.value)) return; // coming back to a checked table
  table.value = text;
  document.getElementById("table-form").requestSubmit();
}

chosen.addEventListener("change", () => check(true));
check(false); // a file that was chosen before this script was here

document.querySelector("#send button")?.removeAttribute("disabled");
document.getElementById("send")?.addEventListener("submit", async (event) => {
  event.preventDefault();
  const note = document.getElementById("sent");
  const token = document.getElementById("token").value.trim();
  const headers = { "Content-Type": "text/csv", ...(token ? { Authorization: `Bearer ${token}` } : {}) };
  const body = table.value;
  note.textContent = "sending …";
  const { to, then } = event.target.dataset; // below the prefix of a proxy, too
  const reply = await fetch(to, { method: "POST", headers, body });
  const said = await reply.json();
  if (reply.ok) window.location.href = then + said.submission_id;
  else note.textContent = said.detail ?? reply.statusText;
});
