using System;
using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>
    /// The rig in the scene: its object is at the rig's origin, with y up and z ahead. Each picture it sends where
    /// the hand and the bodies are, and the effects that are on; the state that comes back is in Unity's axes.
    /// </summary>
    [AddComponentMenu("Tensionlab/Bridge")]
    public class TensionlabBridge : MonoBehaviour
    {
        [Serializable]
        public struct Body
        {
            [Tooltip("As the rig calls it.")]
            public string name;
            public Transform place;
        }

        [Tooltip("As `tensionlab serve` prints it.")]
        public string url = "ws://127.0.0.1:8765/command";
        [Tooltip("Where the hand is.")]
        public Transform hand;
        [Tooltip("Bodies that carry modules.")]
        public Body[] bodies = new Body[0];
        [Min(0.1f), Tooltip("Seconds between attempts to connect.")]
        public float retry = 1f;

        readonly List<HapticEffect> effects = new List<HapticEffect>();
        readonly Dictionary<string, HapticEffect> sent = new Dictionary<string, HapticEffect>();
        BridgeConnection connection;
        double sequence;
        string refused;

        /// <summary>What the rig is; null while there is no bridge.</summary>
        public Welcome Welcome { get; private set; }

        /// <summary>The rig's axes; null before the first state.</summary>
        public RigAxes Axes { get; private set; }

        /// <summary>The latest state; null while there is no bridge.</summary>
        public State State { get; private set; }

        /// <summary>In N, in the world of Unity: what the effects desire, and what the cables do. 0 without State.</summary>
        public Vector3 DesiredForce { get { return State == null ? Vector3.zero : ToWorld(State.Desired); } }

        public Vector3 MeasuredForce { get { return State == null ? Vector3.zero : ToWorld(State.Measured); } }

        public event Action<Welcome> Connected;
        public event Action<string> ConnectionLost;
        public event Action<State> StateReceived;
        public event Action<BridgeEvent> Happened;
        public event Action<string> FrameRefused;

        /// <summary>End the run: all modules release their cables.</summary>
        public void Stop()
        {
            if (connection != null) connection.Stop();
        }

        internal void Add(HapticEffect effect)
        {
            effects.Add(effect);
        }

        internal void Remove(HapticEffect effect)
        {
            effects.Remove(effect);
        }

        void OnEnable()
        {
            connection = new BridgeConnection(url, retry);
        }

        void OnDisable()
        {
            connection.Dispose();
            connection = null;
            Forget();
        }

        void Update()
        {
            object what;
            while (connection != null && connection.TryReceive(out what)) Handle(what);
            if (connection == null || Welcome == null) return;
            try
            {
                if (connection.TrySend(Json.Write(Frame()))) sequence++;
            }
            catch (ArgumentException error)
            {
                Refuse(error.Message);
            }
        }

        void Handle(object what)
        {
            if (what is Lost)
            {
                Forget();
                Debug.LogWarning(((Lost)what).Reason, this);
                Raise(ConnectionLost, ((Lost)what).Reason);
            }
            else if (what is Welcome)
            {
                Welcome = (Welcome)what;
                Raise(Connected, Welcome);
            }
            else if (what is State)
            {
                State = (State)what;
                if (Axes == null) Axes = new RigAxes(Welcome.Up, State.Position.Length);
                else refused = null;  // the first frame has nothing that could be refused
                Raise(StateReceived, State);
            }
            else if (what is Refused) LeaveOut(((Refused)what).Reason);
            else Raise(Happened, (BridgeEvent)what);
        }

        static void Raise<T>(Action<T> whom, T what)
        {
            if (whom != null) whom(what);
        }

        // The first frame only asks how many dimensions the rig has.
        Dictionary<string, object> Frame()
        {
            var frame = new Dictionary<string, object>
            {
                { "type", "frame" }, { "sequence", sequence }, { "time", Time.realtimeSinceStartupAsDouble }
            };
            if (Axes == null) return frame;
            var placed = new Dictionary<string, object>();
            if (hand != null) placed["hand"] = PlaceOf(hand, false);
            foreach (Body body in bodies)
                if (body.place != null) placed[body.name] = PlaceOf(body.place, Axes.Dimension == 3);
            frame["bodies"] = placed;
            var on = new Dictionary<string, object>();
            sent.Clear();
            foreach (HapticEffect effect in effects)
            {
                string name = effect.name;
                for (int number = 2; on.ContainsKey(name); number++) name = effect.name + " " + number;
                sent[name] = effect;
                on[name] = effect.Describe(new RigFrame(transform, Axes));
            }
            frame["effects"] = on;
            return frame;
        }

        Dictionary<string, object> PlaceOf(Transform body, bool turned)
        {
            var rig = new RigFrame(transform, Axes);
            var place = new Dictionary<string, object> { { "position", rig.Point(body.position) } };
            if (turned) place["rotation"] = rig.Turn(body.rotation);
            return place;
        }

        Vector3 ToWorld(double[] wrench)
        {
            return transform.TransformDirection(Axes.ToUnity(wrench));
        }

        // An effect that is refused would have every frame refused: it is left out until it is enabled again.
        void LeaveOut(string reason)
        {
            foreach (KeyValuePair<string, HapticEffect> each in sent)
            {
                if (!reason.StartsWith("effect '" + each.Key + "'")) continue;
                effects.Remove(each.Value);
                reason += "; it is left out until it is enabled again";
            }
            Refuse(reason);
        }

        // Once for each reason: a frame that is wrong comes again with the next picture.
        void Refuse(string reason)
        {
            if (reason == refused) return;
            refused = reason;
            Debug.LogError("The bridge refuses this frame: " + reason, this);
            Raise(FrameRefused, reason);
        }

        void Forget()
        {
            Welcome = null;
            State = null;
            Axes = null;
        }
    }
}
