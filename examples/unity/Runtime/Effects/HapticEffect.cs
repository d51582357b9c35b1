using System.Collections.Generic;
using UnityEngine;

namespace Tensionlab
{
    /// <summary>
    /// Effect that is rendered while its component is enabled; the object's place and axes say where. Its name at
    /// the bridge is that of the object.
    /// </summary>
    public abstract class HapticEffect : MonoBehaviour
    {
        [Tooltip("Left empty: the one in the scene.")]
        public TensionlabBridge bridge;

        protected abstract string Kind { get; }

        /// <summary>The parameters, in the rig's axes.</summary>
        protected abstract void Describe(Dictionary<string, object> parameters, RigFrame rig);

        internal Dictionary<string, object> Describe(RigFrame rig)
        {
            var parameters = new Dictionary<string, object> { { "kind", Kind } };
            Describe(parameters, rig);
            return parameters;
        }

        protected virtual void OnEnable()
        {
            if (bridge == null) bridge = FindObjectOfType<TensionlabBridge>();
            if (bridge != null) bridge.Add(this);
            else Debug.LogError("No TensionlabBridge in the scene, so that nothing renders " + name + "; add one", this);
        }

        protected virtual void OnDisable()
        {
            if (bridge != null) bridge.Remove(this);
        }

        /// <summary>The surface through the object's place, whose way out is the object's y.</summary>
        protected Dictionary<string, object> Plane(RigFrame rig)
        {
            return new Dictionary<string, object>
            {
                { "point", rig.Point(transform.position) }, { "normal", rig.Direction(transform.up) }
            };
        }
    }
}
