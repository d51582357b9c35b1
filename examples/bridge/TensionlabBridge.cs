// A client of the bridge for Unity (2021 or later): put it on the object that follows the hand. Not run by the tests.
//
// Unity's axes are left-handed, the rig's right-handed: z changes its sign. BRIDGE.md has the messages.
using System;
using System.Globalization;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

public class TensionlabBridge : MonoBehaviour
{
    public string url = "ws://127.0.0.1:8765/command";
    [Tooltip("The effects, as JSON; see BRIDGE.md.")]
    [TextArea]
    public string effects =
        "{\"floor\": {\"kind\": \"wall\", \"plane\": {\"point\": [0, 0.3, 0], \"normal\": [0, 1, 0]}}}";

    /// The bridge's latest answer, as JSON.
    public string State { get; private set; } = "";

    private readonly ClientWebSocket socket = new ClientWebSocket();
    private readonly CancellationTokenSource over = new CancellationTokenSource();
    private readonly byte[] buffer = new byte[65536];
    private bool waiting = true;

    private async void Start()
    {
        try
        {
            await socket.ConnectAsync(new Uri(url), over.Token);
            await Receive();  // the welcome
            waiting = false;
        }
        catch (Exception error)
        {
            Debug.LogError($"The bridge at {url} cannot be reached: {error.Message}");
        }
    }

    // One frame a rendered image, unless the answer to the last one is still on its way.
    private async void Update()
    {
        if (waiting || socket.State != WebSocketState.Open) return;
        waiting = true;
        Vector3 hand = transform.position;
        string frame = string.Format(
            CultureInfo.InvariantCulture,
            "{{\"type\": \"frame\", \"time\": {0}, \"bodies\": {{\"hand\": {{\"position\": [{1}, {2}, {3}]}}}}, \"effects\": {4}}}",
            Time.realtimeSinceStartupAsDouble, hand.x, hand.y, -hand.z, effects);
        try
        {
            byte[] content = Encoding.UTF8.GetBytes(frame);
            await socket.SendAsync(new ArraySegment<byte>(content), WebSocketMessageType.Text, true, over.Token);
            string said = await Receive();
            while (said.Contains("\"type\":\"event\"")) said = await Receive();
            State = said;
            waiting = false;
        }
        catch (Exception error) when (!over.IsCancellationRequested)
        {
            Debug.LogError($"The bridge has gone: {error.Message}");
        }
    }

    private async Task<string> Receive()
    {
        var said = new StringBuilder();
        WebSocketReceiveResult part;
        do
        {
            part = await socket.ReceiveAsync(new ArraySegment<byte>(buffer), over.Token);
            said.Append(Encoding.UTF8.GetString(buffer, 0, part.Count));
        } while (!part.EndOfMessage);
        return said.ToString();
    }

    private void OnDestroy()
    {
        over.Cancel();
        socket.Dispose();
    }
}
