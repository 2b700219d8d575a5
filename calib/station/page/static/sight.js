// What one camera sees: its picture if there is one, and its detections over it. An old picture is never shown as a live one.
const OLD_S = 2;
const pictures = new Map(); // camera: {number, image}

function picture(camera, number) {
  const known = pictures.get(camera);
  if (number && (!known || known.number !== number)) {
    const image = new Image();
    image.src = `/preview/${encodeURIComponent(camera)}?n=${number}`;
    pictures.set(camera, { number, image: known?.image?.complete ? known.image : image, next: image });
    image.onload = () => { pictures.get(camera).image = image; };
  }
  const image = pictures.get(camera)?.image;
  return image?.complete && image.naturalWidth ? image : null;
}

export function drawSight(canvas, sight, number, camera) {
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  pen.font = "18px system-ui, sans-serif";
  pen.textAlign = "center";
  if (!sight) {
    pen.fillStyle = "#ff8a8f";
    pen.fillText("no frame yet", width / 2, height / 2);
    return;
  }
  const wanted = Math.round(width * sight.size[1] / sight.size[0]);
  if (Math.abs(wanted - height) > 1) {
    canvas.height = wanted;
    return;
  }
  const old = sight.age_s > OLD_S;
  const image = picture(camera, number);
  if (image && !old) pen.drawImage(image, 0, 0, width, height);
  if (old) {
    pen.fillStyle = "#ff8a8f";
    pen.fillText(`last frame ${Math.round(sight.age_s)} s ago`, width / 2, height / 2);
    return;
  }
  const scale = width / sight.size[0];
  pen.textAlign = "left";
  for (const [u, v, w, h, track, confirmed] of sight.seen) {
    const side = Math.max(10, w * scale), tall = Math.max(10, h * scale);
    pen.strokeStyle = pen.fillStyle = confirmed ? "#63e08a" : "#e3c15b";
    pen.lineWidth = 2;
    pen.strokeRect(u * scale - side / 2, v * scale - tall / 2, side, tall);
    pen.fillText(String(track), u * scale + side / 2 + 3, v * scale - tall / 2);
  }
}
