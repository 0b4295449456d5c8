// Keyframes that were changed at two places since both knew the same, made one list.

const DIGITS = 6;

/**
 * What either added, renamed, deleted or put in order. Where both did, `here` counts; what one renamed the other has not
 * deleted. A keyframe is known by its pose.
 */
export function merged(known, here, there) {
  const lists = [known, here, there], shared = sharedIn(lists);
  const [before, ours, theirs] = lists.map((list) => keyed(list, shared));
  const isRenamed = (key, now) => before.has(key) && now.get(key).name !== before.get(key).name;
  const kept = new Map();
  for (const [key, one] of ours) {
    if (before.has(key) && !theirs.has(key) && !isRenamed(key, ours)) continue; // deleted there
    const takesName = theirs.has(key) && isRenamed(key, theirs) && !isRenamed(key, ours);
    kept.set(key, takesName ? { ...one, name: theirs.get(key).name } : one);
  }
  for (const [key, one] of theirs) {
    if (ours.has(key) || (before.has(key) && !isRenamed(key, theirs))) continue; // deleted here
    kept.set(key, { ...one, picture: null });
  }
  const common = (list, other) => [...list.keys()].filter((key) => other.has(key)).join();
  const isOrderedHere = common(before, ours) !== common(ours, before);
  const order = isOrderedHere ? [...kept.keys()] : [...new Set([...theirs.keys(), ...kept.keys()])];
  return order.filter((key) => kept.has(key)).map((key) => kept.get(key));
}

/** By pose; at poses in `shared`, where several are, by name as well. */
function keyed(keyframes, shared) {
  const byKey = new Map();
  for (const one of keyframes) {
    const pose = poseOf(one), name = shared.has(pose) ? one.name : "";
    let count = 0;
    while (byKey.has(`${pose} ${count} ${name}`)) count++;
    byKey.set(`${pose} ${count} ${name}`, one);
  }
  return byKey;
}

/** The poses that any of the lists has twice. */
function sharedIn(lists) {
  const shared = new Set();
  for (const list of lists) {
    const seen = new Set();
    for (const pose of list.map(poseOf)) (seen.has(pose) ? shared : seen).add(pose);
  }
  return shared;
}

function poseOf(keyframe) {
  return keyframe.pose.flat().map((x) => x.toFixed(DIGITS)).join(" ");
}
